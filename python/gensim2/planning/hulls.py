"""Triangulate convex hulls."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array
from gensim2.objects.shapes import Look, hull_mesh


def surface(hulls: tuple[Array, ...]) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int32]]:
    """Return the vertices (V, 3) and triangles (F, 3) of the surfaces of hulls."""
    meshes = [hull_mesh(hull, Look()) for hull in hulls]
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts[:-1], strict=True)]
    return np.concatenate([mesh.vertices for mesh in meshes]).astype(np.float32), np.concatenate(faces).astype(np.int32)

"""Meshes as convex parts: Wavefront OBJ in, one hull a connected part out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import InputError
from gensim2.objects.library.folder import ObjectFolder

Array = npt.NDArray[np.float64]

#: A part that is flatter than this (metres, at its final scale) is given this thickness: hulls need a volume.
MINIMUM_THICKNESS = 5e-4
SAME_PLACE = 1e-9  # units of the file


@dataclass(frozen=True)
class Parts:
    """Connected parts of one mesh file: vertex sets, each (N, 3) in the file's own units."""

    vertices: tuple[Array, ...]


@lru_cache(maxsize=4096)
def load_parts(folder: Path, name: str) -> Parts:
    """Read an OBJ file and split it where no triangle connects it; vertices at one place count as one.

    Args:
        folder: of the object.
        name: of the file in it.

    Raises:
        MissingFileError: no such file (callers count these).
        InputError: the file is no mesh, leads out of the folder, or has numbers that are not finite.
    """
    from gensim2.objects.library.objfile import read_obj  # here: refusing a file of problems needs no mesh work
    from gensim2.objects.meshwork.decompose import components, weld

    try:
        meshes = read_obj(ObjectFolder(folder), name).meshes
    except ValueError as error:
        raise InputError(str(error), file=folder / name, remedy="repair the mesh") from error
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts[:-1], strict=True)])
    return Parts(tuple(points for points, _ in components(*weld(vertices, faces, SAME_PLACE))))


def convex_points(points: Array) -> Array | None:
    """Return the corners of the convex hull of (N, 3) points in metres, or None where there is no area.

    A flat set is thickened to ``MINIMUM_THICKNESS`` along its normal.
    """
    from scipy.spatial import ConvexHull, QhullError

    centered = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(centered.T @ centered)
    spread = np.ptp(centered @ axes, axis=0)
    if len(points) < 3 or np.sort(spread)[1] < 1e-6:
        return None
    thinnest = int(np.argmin(spread))
    if spread[thinnest] < MINIMUM_THICKNESS:
        shift = 0.5 * (MINIMUM_THICKNESS - spread[thinnest]) * axes[:, thinnest]
        points = np.concatenate([points + shift, points - shift])
    try:
        return np.ascontiguousarray(points[ConvexHull(points).vertices])
    except QhullError:
        return None

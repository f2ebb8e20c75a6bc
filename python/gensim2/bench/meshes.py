"""Meshes as convex parts: Wavefront OBJ in, one hull a connected part out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gensim2.errors import InputError

Array = npt.NDArray[np.float64]

#: A part that is flatter than this (metres, at its final scale) is given this thickness: hulls need a volume.
MINIMUM_THICKNESS = 5e-4


@dataclass(frozen=True)
class Parts:
    """Connected parts of one mesh file: vertex sets, each (N, 3) in the file's own units."""

    vertices: tuple[Array, ...]


@lru_cache(maxsize=4096)
def load_parts(path: Path) -> Parts:
    """Read an OBJ file and split it where no triangle connects it; vertices at one place count as one.

    Raises:
        InputError: unreadable, a bad line, or a number that is not finite.
        FileNotFoundError: no such file (callers count these).
    """
    vertices: list[tuple[float, float, float]] = []
    edges: list[tuple[int, int]] = []
    with path.open(encoding="utf-8", errors="replace") as stream:
        for number, line in enumerate(stream, start=1):
            try:
                if line.startswith("v "):
                    _, x, y, z, *_ = line.split()
                    vertices.append((float(x), float(y), float(z)))
                elif line.startswith("f "):
                    corners = [int(corner.partition("/")[0]) for corner in line.split()[1:]]
                    # A negative index counts back from the vertices read so far.
                    first, *others = [n if n > 0 else len(vertices) + 1 + n for n in corners]
                    edges.extend([(first, other) for other in others])
            except ValueError as error:
                raise InputError(str(error), file=path, field=f"line {number}", remedy="repair the mesh") from error
    points, place = np.unique(np.asarray(vertices, dtype=np.float64).reshape(-1, 3), axis=0, return_inverse=True)
    if not np.isfinite(points).all():
        raise InputError("a vertex is not finite", file=path, remedy="repair the mesh")
    if not edges:
        return Parts(())
    from scipy.sparse import coo_matrix  # here: refusing a file of problems needs no SciPy
    from scipy.sparse.csgraph import connected_components

    ends = np.asarray(edges) - 1
    if ends.min() < 0 or ends.max() >= len(vertices):
        raise InputError("a face names a vertex that does not exist", file=path, remedy="repair the mesh")
    ends = place.reshape(-1)[ends]
    graph = coo_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(len(points), len(points)))
    _, label = connected_components(graph, directed=False)
    used = np.unique(ends)
    order = used[np.argsort(label[used], kind="stable")]
    bounds = np.flatnonzero(np.diff(label[order])) + 1
    return Parts(tuple(points[indices] for indices in np.split(order, bounds)))


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

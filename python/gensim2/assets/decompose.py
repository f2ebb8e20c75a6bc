"""Triangle soup to a few convex hulls.

The released meshes are not watertight, overlap, and come in hundreds of pieces. Each connected piece gets its own hull;
a piece whose hull would fill a cavity is cut up by CoACD; pieces that lie inside others are dropped, and neighbours
whose common hull adds next to nothing are merged.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError, cKDTree

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]

THINNEST = 0.0015  # m: thinner pieces are thickened, physics cannot cook them
SMALLEST = 0.001  # m: pieces smaller than this in every direction are dropped
MAX_VERTICES = 64
MAX_HULLS = 48
FREE_MERGE = 3e-7  # m³ that a merge may add anywhere


@dataclass(frozen=True)
class Hull:
    """A convex hull: vertices (N, 3), outward planes (M, 4) with n·p + d <= 0 inside, volume in m³."""

    points: Array
    planes: Array
    volume: float

    def depth(self, points: Array) -> Array:
        """(K,) distance of points below the hull's surface; negative outside."""
        return np.asarray(-(points @ self.planes[:, :3].T + self.planes[:, 3]).max(axis=1))


def make_hull(points: Array) -> Hull | None:
    """Hull of (N, 3) points, thickened to ``THINNEST`` where flat, at most ``MAX_VERTICES`` vertices; None if too small."""
    center = points.mean(axis=0)
    axes = (
        np.linalg.svd(points - center, full_matrices=True)[2] if len(points) < 400 else _axes(points - center)
    )
    local = (points - center) @ axes.T
    extent = np.ptp(local, axis=0)
    if extent.max() < SMALLEST:
        return None
    for i in range(3):
        if extent[i] < THINNEST:
            middle = (local[:, i].max() + local[:, i].min()) / 2
            low, high = local.copy(), local.copy()
            low[:, i], high[:, i] = middle - THINNEST / 2, middle + THINNEST / 2
            local = np.concatenate([low, high])
    try:
        hull = ConvexHull(local)
        if len(hull.vertices) > MAX_VERTICES:
            corners = local[hull.vertices]
            hull = ConvexHull(corners[np.unique(np.argmax(corners @ _directions().T, axis=0))])
            local = hull.points
    except QhullError:
        return None
    world = local[hull.vertices] @ axes + center
    normals = hull.equations[:, :3] @ axes
    planes = np.column_stack([normals, hull.equations[:, 3] - normals @ center])
    return Hull(world, planes, float(hull.volume))


def _axes(centered: Array) -> Array:
    return np.asarray(np.linalg.eigh(centered.T @ centered)[1].T[::-1])


def _directions() -> Array:
    """``MAX_VERTICES`` directions spread evenly over the sphere, box corners and faces among them."""
    box = np.array(
        [[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z], float
    )
    box /= np.linalg.norm(box, axis=1)[:, None]
    n = MAX_VERTICES - len(box)
    k = np.arange(n) + 0.5
    lat, lon = np.arccos(1 - 2 * k / n), np.pi * (1 + 5**0.5) * k
    spiral = np.column_stack([np.cos(lon) * np.sin(lat), np.sin(lon) * np.sin(lat), np.cos(lat)])
    return np.concatenate([box, spiral])


def components(vertices: Array, faces: Faces, weld: float = 1e-5) -> list[tuple[Array, Faces]]:
    """Connected pieces of a mesh, vertices closer than ``weld`` metres taken as one."""
    if not len(faces):
        return []
    _, inverse = np.unique(np.round(vertices / weld).astype(np.int64), axis=0, return_inverse=True)
    inverse = inverse.ravel()
    welded = inverse[faces]
    n = int(inverse.max()) + 1
    edges = np.concatenate([welded[:, [0, 1]], welded[:, [1, 2]]])
    graph = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n))
    count, label = connected_components(graph, directed=False)
    if count == 1:
        return [(vertices, faces)]
    of_face = label[welded[:, 0]]
    pieces = []
    for k in np.unique(of_face):
        chosen = faces[of_face == k]
        used, renumbered = np.unique(chosen, return_inverse=True)
        pieces.append((vertices[used], renumbered.reshape(-1, 3)))
    return pieces


def drop_contained(hulls: list[Hull], tolerance: float = 5e-4) -> list[Hull]:
    """Leave out hulls that lie inside a bigger one."""
    order = sorted(hulls, key=lambda h: -h.volume)
    kept: list[Hull] = []
    for hull in order:
        low, high = hull.points.min(axis=0), hull.points.max(axis=0)
        inside = False
        for other in kept:
            if (other.points.min(axis=0) > low + tolerance).any() or (
                other.points.max(axis=0) < high - tolerance
            ).any():
                continue
            if (other.depth(hull.points) > -tolerance).all():
                inside = True
                break
        if not inside:
            kept.append(hull)
    return kept


def merge(hulls: list[Hull], limit: int = MAX_HULLS, free: float = FREE_MERGE) -> list[Hull]:
    """Merge neighbours, least added volume first: while it adds less than ``free`` m³, or more than ``limit`` are left."""
    alive: dict[int, Hull] = dict(enumerate(hulls))
    if len(alive) < 2:
        return hulls
    heap: list[tuple[float, int, int]] = []
    joined: dict[tuple[int, int], Hull] = {}

    def consider(i: int, j: int) -> None:
        a, b = (i, j) if i < j else (j, i)
        if (a, b) in joined:
            return
        union = make_hull(np.concatenate([alive[a].points, alive[b].points]))
        if union is not None:
            joined[a, b] = union
            heapq.heappush(heap, (union.volume - alive[a].volume - alive[b].volume, a, b))

    def neighbours(i: int, others: Iterable[int], count: int) -> list[int]:
        low, high = alive[i].points.min(axis=0), alive[i].points.max(axis=0)
        gaps = []
        for j in others:
            p = alive[j].points
            gap = np.maximum(0, np.maximum(p.min(axis=0) - high, low - p.max(axis=0)))
            gaps.append((float(gap @ gap), float(np.linalg.norm(p.mean(axis=0) - (low + high) / 2)), j))
        return [j for _, _, j in sorted(gaps)[:count]]

    centers = np.array([h.points.mean(axis=0) for h in hulls])
    _, near = cKDTree(centers).query(centers, k=min(7, len(hulls)))
    for i in range(len(hulls)):
        for j in near[i]:
            if int(j) != i:
                consider(i, int(j))
        if len(hulls) <= 80:
            for j in neighbours(i, (k for k in alive if k != i), 6):
                consider(i, j)
    following = len(hulls)
    while heap:
        cost, i, j = heapq.heappop(heap)
        if i not in alive or j not in alive:
            continue
        if cost > free and len(alive) <= limit:
            break
        union = joined.pop((i, j))
        del alive[i], alive[j]
        alive[following] = union
        for k in neighbours(following, (k for k in alive if k != following), 6):
            consider(following, k)
        following += 1
    return list(alive.values())

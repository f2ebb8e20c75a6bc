"""Decompose a triangle mesh into a few convex hulls that leave its cavities open.

Released meshes are not watertight. They overlap and have hundreds of pieces. A piece whose hull fills no cavity becomes
this hull. Other pieces are split into thin convex plates along their surface. Then neighbours merge, first the pair
that fills the least free space, so that walls become solid and cavities stay open.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

from gensim2.core.arrays import Array
from gensim2.objects.meshwork.convexes import heights
from gensim2.objects.meshwork.voidspace import NEEDED_VOLUME, VoidSpace

Faces = npt.NDArray[np.int64]

THINNEST = 0.003  # m: thinner pieces are thickened, since physics engines cannot handle them
SMALLEST = 0.001  # m: pieces smaller than this in every direction are dropped
MAX_VERTICES = 64
MAX_HULLS = 40  # maximum number of hulls for each link
MAX_HULLS_FOR_CLEARANCE = 60  # maximum number of hulls of a link if fewer hulls would block the other link
FREE_SHARE = 0.01  # fraction of a hull's volume that may be free space of the mesh
# m³, maximum free space that a hull may fill. Hulls are merged beyond this limit while a link has too many hulls.
FREE_VOLUME = 1e-6
PATCH_ANGLE = np.cos(np.radians(15))
# m, maximum distance of a patch's vertices from the plane of its largest face
PATCH_OFFSET = 0.002
NEIGHBOURS = 5
TRIANGLES_A_PATCH = 60
# A mesh piece with more patches is simplified: vertices closer than one cell of the ``VoidSpace`` are merged, then
# vertices closer than two cells, then three.
MANY_PATCHES = 100


@dataclass(frozen=True)
class Hull:
    """A convex hull: vertices (N, 3), outward planes (M, 4) with n·p + d <= 0 inside, volume in m³."""

    points: Array
    planes: Array
    volume: float

    def depth(self, points: Array) -> Array:
        """Return the depth (K,) of points below the hull's surface; negative outside."""
        return -heights(points, self.planes)


def make_hull(points: Array) -> Hull | None:
    """Return the hull of points (N, 3), made at least ``THINNEST`` thick.

    Return None if all extents of the hull are below ``SMALLEST``.

    At most ``MAX_VERTICES`` vertices are kept: the extreme points in directions that cover the sphere evenly.
    """
    center = points.mean(axis=0)
    centered = points - center
    axes = np.asarray(np.linalg.eigh(centered.T @ centered)[1].T[::-1])
    local = centered @ axes.T
    extent = np.ptp(local, axis=0)
    if extent.max() < SMALLEST:
        return None
    for i in range(3):
        if extent[i] < THINNEST:
            middle = (local[:, i].max() + local[:, i].min()) / 2
            low, high = local.copy(), local.copy()
            low[:, i], high[:, i] = middle - THINNEST / 2, middle + THINNEST / 2
            local = np.concatenate([low, high])
    return _solid_hull(local @ axes + center)


def _solid_hull(points: Array) -> Hull | None:
    """Return the convex hull of points (N, 3) whose thickness is at least ``THINNEST``."""
    center = points.mean(axis=0)
    try:
        hull = ConvexHull(points - center)
        if len(hull.vertices) > MAX_VERTICES:
            corners = hull.points[hull.vertices]
            hull = ConvexHull(corners[np.unique(np.argmax(corners @ _DIRECTIONS.T, axis=0))])
    except QhullError:
        return None
    normals = hull.equations[:, :3]
    planes = np.column_stack([normals, hull.equations[:, 3] - normals @ center])
    return Hull(hull.points[hull.vertices] + center, planes, float(hull.volume))


def _directions() -> Array:
    """Return ``MAX_VERTICES`` directions spread evenly over the sphere, including the corners and faces of a cube."""
    box = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z], float)
    box /= np.linalg.norm(box, axis=1)[:, None]
    n = MAX_VERTICES - len(box)
    k = np.arange(n) + 0.5
    lat, lon = np.arccos(1 - 2 * k / n), np.pi * (1 + 5**0.5) * k
    spiral = np.column_stack([np.cos(lon) * np.sin(lat), np.sin(lon) * np.sin(lat), np.cos(lat)])
    return np.concatenate([box, spiral])


_DIRECTIONS = _directions()


def weld(vertices: Array, faces: Faces, distance: float = 1e-5) -> tuple[Array, Faces]:
    """Merge vertices closer than ``distance`` metres, and drop faces that collapse."""
    _, first, inverse = np.unique(
        np.round(vertices / distance).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    welded = inverse.ravel()[faces]
    real = (welded[:, 0] != welded[:, 1]) & (welded[:, 1] != welded[:, 2]) & (welded[:, 2] != welded[:, 0])
    return vertices[first], welded[real]


def components(vertices: Array, faces: Faces) -> list[tuple[Array, Faces]]:
    """Return the connected pieces of a welded mesh."""
    if not len(faces):
        return []
    n = len(vertices)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    graph = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n))
    _, label = connected_components(graph, directed=False)
    of_face = label[faces[:, 0]]
    pieces = []
    for k in np.unique(of_face):
        chosen = faces[of_face == k]
        used, renumbered = np.unique(chosen, return_inverse=True)
        pieces.append((vertices[used], renumbered.reshape(-1, 3)))
    return pieces


def patches(vertices: Array, faces: Faces) -> list[Faces]:
    """Return connected groups of faces that are coplanar within ``PATCH_ANGLE`` and ``PATCH_OFFSET``."""
    if not len(faces):
        return []
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(areas, 1e-18)[:, None]
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, edge = np.unique(edges, axis=0, return_inverse=True)
    edge = edge.ravel()
    owners: list[list[int]] = [[] for _ in range(int(edge.max()) + 1)]
    for slot, e in enumerate(edge.tolist()):
        owners[e].append(slot // 3)
    taken = np.zeros(len(faces), bool)
    groups = []
    for seed in np.argsort(-areas, kind="stable").tolist():
        if taken[seed]:
            continue
        normal = normals[seed]
        offsets = np.abs((corners - corners[seed, 0]) @ normal).max(axis=1)
        fits = (offsets < PATCH_OFFSET) & ((np.abs(normals @ normal) > PATCH_ANGLE) | (areas < 1e-12)) & ~taken
        group, queue = [], deque([seed])
        taken[seed] = True
        while queue:
            face = queue.popleft()
            group.append(face)
            for e in edge[3 * face : 3 * face + 3].tolist():
                for other in owners[e]:
                    if fits[other] and not taken[other]:
                        taken[other] = True
                        queue.append(other)
        groups.append(faces[np.array(sorted(group))])
    return groups


def plates(vertices: Array, faces: Faces, space: VoidSpace) -> list[Hull]:
    """Return thin hulls that cover a surface without filling free space."""
    found = []
    groups = patches(vertices, faces)
    for cells in (1, 2, 3):
        if len(groups) <= MANY_PATCHES:
            break
        vertices, faces = weld(vertices, faces, cells * space.cell)
        groups = patches(vertices, faces)
    waiting = deque(groups)
    while waiting:
        patch = waiting.popleft()
        hull = make_hull(vertices[np.unique(patch)])
        if hull is None:
            continue
        if len(patch) == 1 or fits(hull, space):
            found.append(hull)
        elif len(patch) <= TRIANGLES_A_PATCH:
            waiting.extend(patch[i : i + 1] for i in range(len(patch)))
        else:
            centers = vertices[patch].mean(axis=1)
            axis = int(np.argmax(np.ptp(centers, axis=0)))
            order = np.argsort(centers[:, axis], kind="stable")
            waiting.extend(np.array_split(patch[order], 2))
    return found


def fits(hull: Hull, space: VoidSpace) -> bool:
    """Return whether a hull fills at most the allowed amount of free space."""
    return space.filled(hull.points, hull.planes) <= allowance(hull.volume, space.cell)


def allowance(volume: float, cell: float) -> float:
    """Return the free volume in m³ that a hull of ``volume`` may fill."""
    return min(max(2 * cell**3, FREE_SHARE * volume), FREE_VOLUME)


def drop_contained(hulls: Sequence[Hull], tolerance: float = 1e-3) -> list[Hull]:
    """Drop each hull that protrudes from a bigger hull by less than ``tolerance`` metres."""
    order = sorted(hulls, key=lambda h: -h.volume)
    kept: list[Hull] = []
    lows, highs = np.zeros((len(order), 3)), np.zeros((len(order), 3))
    for hull in order:
        low, high = hull.points.min(axis=0), hull.points.max(axis=0)
        n = len(kept)
        around = (lows[:n] <= low + tolerance).all(axis=1) & (highs[:n] >= high - tolerance).all(axis=1)
        if not any((kept[k].depth(hull.points) > -tolerance).all() for k in np.flatnonzero(around)):
            lows[n], highs[n] = low, high
            kept.append(hull)
    return kept


class _Merger:
    """Object that merges hulls in pairs.

    The first pair is the one that fills the least free space; among equals it is the one with the smallest common hull.

    Common hulls are expensive to compute, so pairs wait in a priority queue with lower bounds: zero for the filled
    space, and the volume of the bigger hull. The common hull of a pair is computed when the pair reaches the front.
    Most pairs never do, because one of their hulls is merged before.
    """

    def __init__(self, hulls: list[Hull], space: VoidSpace) -> None:
        self.space = space
        self.alive: dict[int, Hull] = {}
        self._filled: dict[int, float] = {}
        self._low: Array = np.full((2 * len(hulls), 3), np.inf)
        self._high: Array = np.full((2 * len(hulls), 3), -np.inf)
        self._heap: list[tuple[float, float, int, int]] = []
        self._paired: set[tuple[int, int]] = set()
        self._unions: dict[tuple[int, int], Hull] = {}
        for hull in hulls:
            self._add(hull)
        for i in list(self.alive):
            self._pair_up(i)

    def _add(self, hull: Hull) -> int:
        number = len(self._filled)
        self.alive[number] = hull
        self._filled[number] = self.space.filled(hull.points, hull.planes)
        self._low[number], self._high[number] = hull.points.min(axis=0), hull.points.max(axis=0)
        return number

    def _pair_up(self, i: int) -> None:
        gap = np.maximum(0, np.maximum(self._low - self._high[i], self._low[i] - self._high))
        span = np.maximum(self._high, self._high[i]) - np.minimum(self._low, self._low[i])
        with np.errstate(invalid="ignore"):
            distance = (gap**2).sum(axis=1) + 1e-3 * (span**2).sum(axis=1)
        distance[~np.isfinite(distance)] = np.inf
        distance[i] = np.inf
        for j in np.argsort(distance, kind="stable")[:NEIGHBOURS].tolist():
            a, b = min(i, j), max(i, j)
            if np.isfinite(distance[j]) and (a, b) not in self._paired:
                self._paired.add((a, b))
                heapq.heappush(self._heap, (0.0, max(self.alive[a].volume, self.alive[b].volume), a, b))

    def _measure(self, a: int, b: int) -> None:
        union = _solid_hull(np.concatenate([self.alive[a].points, self.alive[b].points]))
        if union is not None:
            self._unions[a, b] = union
            more = self.space.filled(union.points, union.planes) - self._filled[a] - self._filled[b]
            heapq.heappush(self._heap, (max(more, 0.0), union.volume, a, b))

    def run(self, limit: int) -> list[Hull]:
        while self._heap:
            cost, volume, a, b = heapq.heappop(self._heap)
            if a not in self.alive or b not in self.alive:
                continue
            if (a, b) not in self._unions:
                self._measure(a, b)
                continue
            if cost > allowance(volume, self.space.cell) and len(self.alive) <= limit:
                continue
            if cost >= NEEDED_VOLUME and len(self.alive) <= MAX_HULLS_FOR_CLEARANCE:
                continue
            union = self._unions.pop((a, b))
            for k in (a, b):
                del self.alive[k]
                self._low[k], self._high[k] = np.inf, -np.inf
            swallowed = [
                k
                for k in np.flatnonzero(
                    (self._low >= union.points.min(axis=0) - 1e-4).all(axis=1)
                    & (self._high <= union.points.max(axis=0) + 1e-4).all(axis=1)
                ).tolist()
                if k in self.alive and (union.depth(self.alive[k].points) > -1e-4).all()
            ]
            for k in swallowed:
                del self.alive[k]
                self._low[k], self._high[k] = np.inf, -np.inf
            self._pair_up(self._add(union))
        return list(self.alive.values())


@dataclass(frozen=True)
class Decomposition:
    """Hulls of a link, each (N, 3).

    ``dropped`` is the number of tiny pieces, and ``opened`` the number of pieces that were split at a cavity.
    """

    hulls: list[Array]
    dropped: int
    opened: int


def connected_pieces(meshes: Sequence[tuple[Array, Faces]]) -> list[tuple[Array, Faces]]:
    """Return the connected pieces of several meshes, each (vertices (N, 3), faces (M, 3))."""
    return [piece for vertices, faces in meshes for piece in components(*weld(vertices, faces))]


def decompose(
    pieces: Sequence[tuple[Array, Faces]], space: VoidSpace | None = None, limit: int = MAX_HULLS
) -> Decomposition:
    """Return the convex decomposition of the connected pieces of one link.

    Args:
        pieces: (vertices (N, 3) in metres, faces (M, 3)).
        space: free space around the pieces. If None, the function computes it.
        limit: maximum number of hulls. Even cavities are filled to keep this limit. Space that the other link needs is
            filled only above ``MAX_HULLS_FOR_CLEARANCE`` hulls.
    """
    if not pieces:
        return Decomposition([], 0, 0)
    space = space or VoidSpace(list(pieces))
    hulls: list[Hull] = []
    concave: list[tuple[Array, Faces]] = []
    dropped = 0
    for vertices, faces in pieces:
        hull = make_hull(vertices)
        if hull is None:
            dropped += 1
        elif fits(hull, space):
            hulls.append(hull)
        else:
            concave.append((vertices, faces))
    for vertices, faces in concave:
        hulls += plates(vertices, faces, space)
    merged = _Merger(drop_contained(hulls), space).run(limit)
    return Decomposition([h.points for h in drop_contained(merged)], dropped, len(concave))


FLAT = 1e-5
"""Thickness in m below which a piece has no volume, and PhysX creates no hull of it."""


def piece_hulls(meshes: Sequence[tuple[Array, Faces]]) -> tuple[list[Array], int]:
    """Return one convex hull for each connected piece of a link's meshes.

    Thin pieces are thickened, as in :func:`decompose`, because physics engines differ in how they treat thin hulls.

    Args:
        meshes: vertices (N, 3) in metres and faces (M, 3) of each mesh of the link.

    Returns:
        The hulls, each (N, 3), and the number of pieces that are left out because they are flat or smaller than a
        millimetre.
    """
    found: list[Array] = []
    dropped = 0
    for vertices, _ in connected_pieces(meshes):
        hull = None if _thickness(vertices) < FLAT else make_hull(vertices)
        if hull is None:
            dropped += 1
        else:
            found.append(hull.points)
    return found, dropped


def _thickness(points: Array) -> float:
    """Return the least extent (m) of (N, 3) points along their principal axes."""
    centered = points - points.mean(axis=0)
    axes = np.linalg.eigh(centered.T @ centered)[1]
    return float(np.ptp(centered @ axes, axis=0).min())

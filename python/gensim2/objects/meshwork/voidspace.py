"""Compute the free space around a mesh on a grid, to measure how much of it a convex hull would fill."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh
from scipy import ndimage
from scipy.spatial import cKDTree

from gensim2.core.arrays import Array
from gensim2.core.foreign.geometry import opened_mesh
from gensim2.objects.meshwork.convexes import (
    HINGE,
    ConvexBlock,
    depth_inside,
    heights,
    in_box,
    surface_samples,
    triangle_weights,
)
from gensim2.objects.shapes import transform
from gensim2.objects.types import ArticulatedObject

Faces = npt.NDArray[np.int64]

FINEST = 0.003  # m, edge length of a cell
CELLS = 96  # number of cells along the longest side of a large link
MAX_FINE_CELLS = 8_000_000
CHUNK = 400_000  # number of sample points processed at a time
# Penalty (m³) for each point of the other link's path in a hull, added to the filled free space. One such point exceeds
# ``FREE_VOLUME`` (m³), so the hull is unacceptable.
NEEDED_VOLUME = 1.1e-6
# m. A point through which the other link moves is penalized only if it lies deeper than this in a hull.
NEEDED_DEPTH = 0.0008
# approximate maximum number of cells tested in a hull; in a bigger hull only every n-th cell along each axis is tested
MAX_PROBES = 5000


class VoidSpace:
    """Grid of free cells: cells that the surface does not cross and that are connected to the outside.

    Meshes need not be watertight. Space whose openings are narrower than a cell is enclosed and counts as solid.

    Attributes:
        cell: edge length of a cell in metres.
        low, high: (3,) corners of the box around the link.
    """

    def __init__(self, meshes: Sequence[tuple[Array, Faces]]) -> None:
        """Compute the cells from the meshes (vertices (N, 3) in metres, faces (M, 3)) of one link, all in its frame."""
        points = np.concatenate([v for v, _ in meshes])
        low, high = points.min(axis=0), points.max(axis=0)
        self.cell = max(FINEST, float((high - low).max()) / CELLS)
        self._meshes = list(meshes)
        self.low, self.high = low, high
        self._low = low - 2 * self.cell
        self._shape = tuple(int(n) for n in np.ceil((high - low) / self.cell) + 4)
        crossed = np.zeros(self._shape, bool)
        for vertices, faces in meshes:
            for samples in self._samples(vertices[faces], self.cell):
                index = ((samples - self._low) / self.cell).astype(np.int64)
                crossed[index[:, 0], index[:, 1], index[:, 2]] = True
        label, _ = ndimage.label(~crossed)
        self._free = label == label[0, 0, 0]
        self._needed = np.zeros((0, 3))  # points of ``keep_clear``, sorted along one axis
        self._needed_axis = 0

    def occupied(self) -> Array:
        """Return the centres (N, 3) of the unreachable cells: the cells that the meshes cross or enclose."""
        return np.asarray(self._low + (np.argwhere(~self._free) + 0.5) * self.cell)

    def is_free(self, points: Array) -> npt.NDArray[np.bool_]:
        """Return a mask of the points (N, 3) that can be reached from outside."""
        index = np.floor((points - self._low) / self.cell).astype(np.int64)
        inside = ((index >= 0) & (index < self._shape)).all(axis=1)
        found = np.ones(len(points), bool)
        i = index[inside]
        found[inside] = self._free[i[:, 0], i[:, 1], i[:, 2]]
        return found

    def is_free_finely(self, points: Array, finest: float) -> npt.NDArray[np.bool_]:
        """Return a mask of the points (N, 3) that are reachable from outside, more accurately than ``is_free``.

        Points in grid cells that are not free are tested again on a finer grid around these points.

        Args:
            points: (N, 3) points in the link's frame, m.
            finest: cell size of the finer grid, m. Larger cells are used if this grid would need too much memory.
        """
        found = self.is_free(points)
        doubtful = points[~found]
        if not len(doubtful):
            return found
        low, high = doubtful.min(axis=0) - 2 * self.cell, doubtful.max(axis=0) + 2 * self.cell
        cell = max(finest, float(np.prod(high - low) / MAX_FINE_CELLS) ** (1 / 3))
        shape = np.ceil((high - low) / cell).astype(np.int64)
        crossed = np.zeros(shape, bool)
        for vertices, faces in self._meshes:
            triangles = vertices[faces]
            near = ((triangles.max(axis=1) > low) & (triangles.min(axis=1) < high)).all(axis=1)
            for samples in self._samples(triangles[near], cell):
                index = np.floor((samples - low) / cell).astype(np.int64)
                index = index[((index >= 0) & (index < shape)).all(axis=1)]
                crossed[index[:, 0], index[:, 1], index[:, 2]] = True
        # A fine cell counts as free if a path of empty fine cells connects the cell to a free coarse cell.
        coarse = [
            np.clip((low[i] + (np.arange(shape[i]) + 0.5) * cell - self._low[i]) / self.cell, 0, self._shape[i] - 1)
            for i in range(3)
        ]
        seeds = self._free[np.ix_(*(index.astype(np.int64) for index in coarse))] & ~crossed
        label, count = ndimage.label(~crossed)
        is_open = np.zeros(count + 1, bool)
        is_open[label[seeds]] = True
        is_open[0] = False
        i = ((doubtful - low) / cell).astype(np.int64)
        found[~found] = is_open[label[i[:, 0], i[:, 1], i[:, 2]]]
        return found

    def keep_clear(self, points: Array) -> None:
        """Set points (N, 3) of the other link's path.

        Hulls should not cover these points, and :meth:`filled` penalizes hulls that do.
        """
        self._needed_axis = int(np.argmax(np.ptp(points, axis=0))) if len(points) else 0
        self._needed = points[np.argsort(points[:, self._needed_axis], kind="stable")]

    @staticmethod
    def _samples(triangles: Array, cell: float) -> list[Array]:
        """Return points on triangles (M, 3, 3).

        The distance of neighbours is less than ``cell`` (m), the edge of a grid cell.
        """
        edges = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
        steps = np.maximum(1, np.ceil(edges / (0.7 * cell))).astype(np.int64)
        batches = []
        for n in np.unique(steps):
            weights = triangle_weights(int(n))
            chosen = triangles[steps == n]
            for part in np.array_split(chosen, max(1, len(chosen) * len(weights) // CHUNK)):
                batches.append(np.matmul(weights, part).reshape(-1, 3))
        return batches

    def filled(self, points: Array, planes: Array) -> float:
        """Return the free volume in m³ inside the hull with vertices (N, 3) and outward planes (M, 4).

        Each point of ``keep_clear`` inside the hull adds ``NEEDED_VOLUME``.
        """
        low, high = points.min(axis=0), points.max(axis=0)
        needed = 0
        if len(self._needed):
            axis = self._needed_axis
            start, end = np.searchsorted(self._needed[:, axis], [low[axis], high[axis]])
            near = self._needed[start:end]
            near = near[in_box(near, low, high)]
            if len(near):
                needed = int((heights(near, planes) < -NEEDED_DEPTH).sum())
        return self._void(points, planes, low, high) + needed * NEEDED_VOLUME

    def _void(self, points: Array, planes: Array, low: Array, high: Array) -> float:
        widths = np.ptp(points @ planes[:, :3].T, axis=0)
        thin = int(np.argmin(widths))
        if widths[thin] < 2 * self.cell:
            return self._void_in_plate(points, planes, planes[thin, :3], float(widths[thin]))
        first = np.maximum(((low - self._low) / self.cell).astype(np.int64), 0)
        last = ((high - self._low) / self.cell).astype(np.int64) + 1
        stride = max(1, int(np.ceil((np.prod(last - first) / MAX_PROBES) ** (1 / 3))))
        offset = (stride - 1) // 2
        window = tuple(slice(a + offset, b, stride) for a, b in zip(first, last, strict=True))
        index = np.argwhere(self._free[window])
        if not len(index):
            return 0.0
        centers = self._low + (index * stride + first + offset + 0.5) * self.cell
        return float((heights(centers, planes) < -0.5 * self.cell).sum()) * (stride * self.cell) ** 3

    def _void_in_plate(self, points: Array, planes: Array, normal: Array, width: float) -> float:
        """Return the free volume (m³) in a hull that is thinner than two cells.

        The free volume is the free area of the middle plane of the hull times the thickness.

        Args:
            points, planes: vertices (N, 3) and outward planes (M, 4) of the hull.
            normal: (3,) unit normal of the plate.
            width: thickness of the plate, m.
        """
        u = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
        u /= np.linalg.norm(u)
        v = np.cross(normal, u)
        flat = points @ np.stack([u, v, normal], axis=1)
        low, high = flat.min(axis=0), flat.max(axis=0)
        step = max(self.cell, float(np.sqrt((high - low)[0] * (high - low)[1] / MAX_PROBES)))
        a, b = (np.arange(low[i] + step / 2, high[i], step) for i in (0, 1))
        if not len(a) or not len(b):
            return 0.0
        grid = np.stack(np.meshgrid(a, b, indexing="ij"), axis=-1).reshape(-1, 2)
        probes = grid @ np.stack([u, v]) + 0.5 * (low[2] + high[2]) * normal
        edge = np.abs(planes[:, :3] @ normal) < 0.5  # side faces of the plate, without its two large faces
        inside = np.ones(len(probes), bool)
        if edge.any():
            inside = heights(probes, planes[edge]) < -0.5 * self.cell
        return float(self.is_free(probes[inside]).sum()) * step * step * width


OPENNESS = (0.0, 0.25, 0.5, 0.75, 1.0)
MESH_SPACING = 0.002  # m, distance between neighbouring sample points on a mesh
GAP = 0.0012  # m: narrower gaps of a mesh count as closed
# Points closer to a mesh than this (m) belong to the mesh, because thin sheets are thickened by this much.
SKIN = 0.0032
NEAREST = 8  # number of candidate triangles that are compared to find the triangle closest to a point


def _off_hinge(instance: ArticulatedObject, points: Array) -> Array:
    """Return the points outside the hinge region, selected from points (N, 3) in the root frame."""
    joint = instance.joint
    if joint.type != "revolute":
        return points
    apart = np.linalg.norm(np.cross(points - joint.origin, joint.axis), axis=1)
    return np.asarray(points[apart > HINGE], float)


@dataclass(frozen=True)
class Overlap:
    """Maximum penetration depths, in metres, between the two links of an object.

    Each depth is the maximum over the joint positions ``OPENNESS``. The region around the hinge is not examined.

    Attributes:
        parts: penetration depth of the two links' convex parts.
        filled: penetration depth of the convex parts at points farther than ``SKIN`` from the mesh of a link, caused by
            the decomposition.
        meshes: depth to which the mesh of one link enters the space enclosed by the mesh of the other link.
    """

    parts: float
    filled: float
    meshes: float


def hull_overlap(instance: ArticulatedObject) -> float:
    """Return the maximum overlap (m) of the convex parts of both links at any of ``OPENNESS``, outside the hinge."""
    return max((float(depths.max()) for _, _, depths in _common_points(instance, 0.0)), default=0.0)


def links_overlap(instance: ArticulatedObject, threshold: float) -> Overlap:
    """Measure how deeply the links of an object overlap, in their meshes or only in the decomposition.

    Meshes are examined if the convex parts overlap by more than ``threshold`` metres. Real meshes are seldom
    watertight, so space behind gaps narrower than ``GAP`` counts as enclosed. The depth of a point is its distance from
    the mesh.
    """
    common = _common_points(instance, threshold)
    if not common:
        return Overlap(hull_overlap(instance), 0.0, 0.0)
    joint = instance.joint
    depths = np.concatenate([depths for _, _, depths in common])
    root = next(link for link in instance.hulls if link != joint.child_link)
    still, moving = _meshes(instance, root), _meshes(instance, joint.child_link)
    if not still or not moving:
        return Overlap(float(depths.max()), float(depths.max()), 0.0)
    body, child = _Enclosed(still), _Enclosed(moving)
    in_root = np.concatenate([points for _, points, _ in common])
    in_child = np.concatenate([transform(np.asarray(np.linalg.inv(T), float), points) for T, points, _ in common])
    added = ~(body.encloses(in_root) & child.encloses(in_child))
    poses = [instance.link_pose(share) for share in OPENNESS]
    theirs = [_off_hinge(instance, transform(T, child.points)) for T in poses]
    ours = _off_hinge(instance, body.points)
    back = [transform(np.asarray(np.linalg.inv(T), float), ours) for T in poses]
    meshes = max(body.depth(np.concatenate(theirs)), child.depth(np.concatenate(back)))
    return Overlap(float(depths.max()), float(depths[added].max(initial=0.0)), meshes)


def _common_points(instance: ArticulatedObject, threshold: float) -> list[tuple[Array, Array, Array]]:
    """Return points at which the convex parts of both links overlap by more than ``threshold`` metres.

    Points near the hinge are left out. The list has for each openness the pose of the moving link (4, 4), the points
    (N, 3) in the root frame, and their depths (N,), m.
    """
    joint = instance.joint
    body = next((list(h) for link, h in instance.hulls.items() if link != joint.child_link), [])
    moving = list(instance.hulls[joint.child_link])
    if not body or not moving:
        return []
    of_body = np.asarray(np.concatenate([surface_samples(h) for h in body]), float)
    of_moving = np.asarray(np.concatenate([surface_samples(h) for h in moving]), float)
    body_blocks, moving_blocks = ([ConvexBlock.of(h) for h in hulls] for hulls in (body, moving))
    found = []
    for share in OPENNESS:
        T = instance.link_pose(share)
        back = np.asarray(np.linalg.inv(T), float)
        theirs, ours = _off_hinge(instance, transform(T, of_moving)), _off_hinge(instance, of_body)
        points = np.concatenate([theirs, ours])
        depth = np.concatenate([depth_inside(theirs, body_blocks), depth_inside(transform(back, ours), moving_blocks)])
        deep = depth > threshold
        if deep.any():
            found.append((T, points[deep], depth[deep]))
    return found


def _meshes(instance: ArticulatedObject, link: str) -> list[tuple[Array, Faces]]:
    file = instance.urdf.parent / "visual" / f"{link}.glb"
    if not file.is_file():
        return []
    with opened_mesh(file) as scene:
        return [
            (np.asarray(part.vertices, float), np.asarray(part.faces, np.int64))
            for part in scene.dump()
            if isinstance(part, trimesh.Trimesh)
        ]


class _Enclosed:
    """Volume that the meshes of a link enclose."""

    def __init__(self, meshes: list[tuple[Array, Faces]]) -> None:
        self._space = VoidSpace(meshes)
        self._triangles = np.concatenate([vertices[faces] for vertices, faces in meshes])
        self.points, self._owner = _samples(self._triangles)
        self._tree = cKDTree(self.points)

    def encloses(self, points: Array) -> npt.NDArray[np.bool_]:
        """Return a mask of the points (N, 3) that are unreachable from outside or within ``SKIN`` of the mesh."""
        near = np.asarray(self._tree.query(points)[0], float) < SKIN
        return near | ~self._space.is_free_finely(points, GAP)

    def depth(self, points: Array) -> float:
        """Return the maximum distance (m) of the points (N, 3) that are enclosed from the meshes, or 0 if none is."""
        inside = points[((points > self._space.low) & (points < self._space.high)).all(axis=1)]
        inside = inside[~self._space.is_free(inside)]
        if not len(inside):
            return 0.0
        inside = inside[~self._space.is_free_finely(inside, GAP)]
        if not len(inside):
            return 0.0
        deep = self._tree.query(inside)[0] > 0.5 * MESH_SPACING
        inside = inside[deep]
        if not len(inside):
            return 0.0
        _, nearest = self._tree.query(inside, k=min(NEAREST, len(self.points)))
        nearest = nearest.reshape(len(inside), -1)
        width = nearest.shape[1]
        triangles = self._triangles[self._owner[nearest].ravel()]
        repeated = np.repeat(inside, width, axis=0)
        closest = trimesh.triangles.closest_point(triangles, repeated)
        return float(np.linalg.norm(closest - repeated, axis=1).reshape(-1, width).min(axis=1).max())


def _samples(triangles: Array) -> tuple[Array, npt.NDArray[np.int64]]:
    """Return points (N, 3) on triangles (M, 3, 3), at most ``MESH_SPACING`` apart, and each point's triangle."""
    edges = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
    steps = np.maximum(1, np.ceil(edges / MESH_SPACING)).astype(np.int64)
    points, owners = [], []
    for n in np.unique(steps):
        i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
        u, v = i[i + j <= n] / n, j[i + j <= n] / n
        chosen = np.flatnonzero(steps == n)
        points.append(np.matmul(np.stack([1 - u - v, u, v], axis=1), triangles[chosen]).reshape(-1, 3))
        owners.append(np.repeat(chosen, len(u)))
    where, owner = np.concatenate(points), np.concatenate(owners)
    cells = np.floor((where - where.min(axis=0)) / (0.5 * MESH_SPACING)).astype(np.int64)
    size = cells.max(axis=0) + 1
    _, first = np.unique((cells[:, 0] * size[1] + cells[:, 1]) * size[2] + cells[:, 2], return_index=True)
    return where[first], owner[first]

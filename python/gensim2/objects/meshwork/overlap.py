"""Penetration depth of two links: of the convex parts that are simulated, and as the meshes of the model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh
from scipy.spatial import cKDTree

from gensim2.core.foreign.geometry import opened_mesh
from gensim2.objects.meshwork.convexes import HINGE, Block, depth_inside, surface_samples
from gensim2.objects.meshwork.voidspace import Faces, VoidSpace
from gensim2.objects.shapes import transform
from gensim2.objects.types import ArticulatedObject

Array = npt.NDArray[np.float64]

OPENNESS = (0.0, 0.25, 0.5, 0.75, 1.0)
MESH_SPACING = 0.002  # m between points that stand for a mesh
GAP = 0.0012  # m: narrower gaps of a mesh count as closed
SKIN = 0.0032  # m around a mesh that its convex parts may stand for: they are thicker than a sheet
NEAREST = 8  # triangles among which the closest is looked for


def _off_hinge(instance: ArticulatedObject, points: Array) -> Array:
    """Those of (N, 3) points in the root frame that do not count as hinge."""
    joint = instance.joint
    if joint.type != "revolute":
        return points
    apart = np.linalg.norm(np.cross(points - joint.origin, joint.axis), axis=1)
    return np.asarray(points[apart > HINGE], float)


@dataclass(frozen=True)
class Overlap:
    """Penetration depth between the links of an object, off the hinge, at any of ``OPENNESS``; metres.

    Attributes:
        parts: of the convex parts, anywhere.
        filled: of the convex parts, where at least one of the meshes leaves space, ``SKIN`` aside: what the parts add.
        meshes: of the meshes: how deep one lies in what the other encloses.
    """

    parts: float
    filled: float
    meshes: float


def hull_overlap(instance: ArticulatedObject) -> float:
    """Deepest that a convex part of one link lies in one of the other at any of ``OPENNESS``, metres, off the hinge."""
    return max((float(depths.max()) for _, _, depths in _common_points(instance, 0.0)), default=0.0)


def links_overlap(instance: ArticulatedObject, threshold: float) -> Overlap:
    """Measure the overlap, and tell whether the model or its convex parts are to blame.

    Meshes are looked at only where convex parts overlap by more than ``threshold`` metres. Those of real models are
    seldom watertight: what cannot be reached from outside through gaps wider than ``GAP`` counts as enclosed, and depth
    in a mesh is the distance to it.
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
    """Points off the hinge where convex parts of both links are, deeper than ``threshold`` metres, by openness.

    Each: pose (4, 4) of the moving link, (N, 3) in the root frame, (N,) depth.
    """
    joint = instance.joint
    body = next((list(h) for link, h in instance.hulls.items() if link != joint.child_link), [])
    moving = list(instance.hulls[joint.child_link])
    if not body or not moving:
        return []
    of_body = np.asarray(np.concatenate([surface_samples(h) for h in body]), float)
    of_moving = np.asarray(np.concatenate([surface_samples(h) for h in moving]), float)
    body_blocks, moving_blocks = ([Block.of(h) for h in hulls] for hulls in (body, moving))
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
    """Visual meshes of a link, in its frame; none where it has none."""
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
    """Volume that a link's meshes enclose."""

    def __init__(self, meshes: list[tuple[Array, Faces]]) -> None:
        self._space = VoidSpace(meshes)
        self._triangles = np.concatenate([vertices[faces] for vertices, faces in meshes])
        self.points, self._owner = _samples(self._triangles)
        self._tree = cKDTree(self.points)

    def encloses(self, points: Array) -> npt.NDArray[np.bool_]:
        """Which of (N, 3) points cannot be reached from outside, those within ``SKIN`` of the mesh among them."""
        near = np.asarray(self._tree.query(points)[0], float) < SKIN
        return near | ~self._space.is_free_finely(points, GAP)

    def depth(self, points: Array) -> float:
        """Largest distance, metres, from the meshes of those of (N, 3) points that are enclosed; 0 where none is."""
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
    """Points (N, 3) on (M, 3, 3) triangles, ``MESH_SPACING`` apart or closer, and the triangle of each."""
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

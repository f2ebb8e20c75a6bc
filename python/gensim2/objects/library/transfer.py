"""Transfer the keypoints of one object of a class to another object of the same class."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from trimesh.triangles import closest_point

from gensim2.core.arrays import Array
from gensim2.objects.meshwork.convexes import surface_samples
from gensim2.objects.shapes import Mesh, transform
from gensim2.objects.types import ArticulatedObject

ON_SURFACE = 0.01
"""Maximum distance (m) of a keypoint from its link at which the keypoint lies on the surface of the link."""
THINNEST = 1e-9
"""Smallest extent (m) of a bounding box."""


@dataclass(frozen=True)
class RelativeKeypoint:
    """Position of a keypoint relative to the bounding box of its link.

    The edges of the box are parallel to the axes of the object's root frame, and the joint is at its lower limit.

    Attributes:
        fraction: (3,) nearest point of the box, as numbers from 0 to 1 between the lower and the upper end of each
            edge.
        beyond: (3,) vector from this point to the keypoint, m; zero for a keypoint in the box.
        is_moving: whether the joint moves the keypoint.
        is_on_surface: whether the keypoint lies on the surface of its link.
        description: phrase that describes the keypoint.
    """

    fraction: Array
    beyond: Array
    is_moving: bool
    is_on_surface: bool
    description: str

    def on(self, meshes: Sequence[Mesh], T_root_link: Array, scale: float) -> Array:
        """Return the position (3,) of the keypoint on another link, in this link's frame and in units of its model.

        Args:
            meshes: meshes of the link in its frame, in units of the model.
            T_root_link: (4, 4) pose of the link in the root frame, with the joint at its lower limit.
            scale: length of one unit of the model, m.
        """
        low, high = _box(np.concatenate([mesh.vertices for mesh in meshes]), T_root_link)
        at = low + self.fraction * (high - low) + self.beyond / scale
        at = transform(np.asarray(np.linalg.inv(T_root_link)), at[None])[0]
        return on_surface(at, meshes) if self.is_on_surface else np.asarray(at)


def relative_keypoints(model: ArticulatedObject) -> dict[str, RelativeKeypoint]:
    """Return the keypoints of an object relative to the bounding boxes of their links, by name."""
    found = {}
    for name, keypoint in model.keypoints.items():
        is_moving = keypoint.link == model.joint.child_link
        T = model.link_pose(0.0) if is_moving else np.eye(4)
        hulls = model.hulls[keypoint.link]
        low, high = _box(np.concatenate(hulls), T)
        at = transform(T, keypoint.position[None])[0]
        inside = np.clip(at, low, high)
        gap, _ = cKDTree(np.concatenate([surface_samples(hull) for hull in hulls])).query(keypoint.position)
        found[name] = RelativeKeypoint(
            fraction=(inside - low) / np.maximum(high - low, THINNEST),
            beyond=at - inside,
            is_moving=is_moving,
            is_on_surface=bool(gap <= ON_SURFACE),
            description=keypoint.description,
        )
    return found


def on_surface(point: Array, meshes: Sequence[Mesh]) -> Array:
    """Return the point (3,) of the meshes' surface that is nearest to ``point``."""
    triangles = np.concatenate([mesh.vertices[mesh.faces] for mesh in meshes])
    nearest = closest_point(triangles, np.broadcast_to(point, (len(triangles), 3)))
    return np.asarray(nearest[int(np.argmin(np.linalg.norm(nearest - point, axis=1)))], float)


def _box(points: Array, T_root_link: Array) -> tuple[Array, Array]:
    """Return the corners (3,) of the bounding box of points (N, 3) in the root frame."""
    placed = transform(T_root_link, points)
    return placed.min(axis=0), placed.max(axis=0)

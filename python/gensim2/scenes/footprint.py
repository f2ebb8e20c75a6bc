"""Compute outlines of objects as seen from above, gaps between outlines, and the lowest point of a moving link."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from gensim2.core.arrays import Array
from gensim2.objects import RigidObject
from gensim2.objects.shapes import transform
from gensim2.objects.types import BODY, ArticulatedObject

JOINT_SAMPLES = 13


def hulls_in_root(model: ArticulatedObject | RigidObject, value: float) -> list[Array]:
    """Return the hulls of an object at the joint position ``value``, each (N, 3) in the root frame, metres."""
    if isinstance(model, RigidObject):
        return list(model.hulls[BODY])
    moving = model.joint.child_link
    still = [hull for link, hulls in model.hulls.items() if link != moving for hull in hulls]
    return still + [_on_moving_link(hull, model, value) for hull in model.hulls.get(moving, ())]


def swept_points(model: ArticulatedObject | RigidObject) -> Array:
    """Return the vertices of the convex hull of the space that an object occupies over the range of its joint.

    Returns:
        (N, 3) points in the root frame, m.
    """
    if isinstance(model, RigidObject):
        values = [0.0]
    else:
        values = list(np.linspace(model.joint.lower, model.joint.upper, JOINT_SAMPLES))
    points = np.concatenate([hull for value in values for hull in hulls_in_root(model, value)])
    return np.asarray(points[ConvexHull(points).vertices], dtype=np.float64)


def lowest_of_moving_link(model: ArticulatedObject, position: Array, quaternion: Array) -> float:
    """Return the smallest height (m) that any point of the moving link has while the joint moves through its range.

    Args:
        position: (3,) position of the object's root in the world frame, m.
        quaternion: (4,) orientation of the object's root in the world frame, (w, x, y, z).
    """
    hulls = model.hulls.get(model.joint.child_link, ())
    if not hulls:
        return float("inf")
    points = np.concatenate(hulls)
    up = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()[2]
    values = np.linspace(model.joint.lower, model.joint.upper, JOINT_SAMPLES)
    return float(position[2]) + min(float((_on_moving_link(points, model, value) @ up).min()) for value in values)


def keypoint_in_root(model: ArticulatedObject, name: str, value: float) -> Array:
    """Return a keypoint (3,), m in the root frame, at joint value ``value`` (rad or m)."""
    point = model.keypoints[name]
    if point.link != model.joint.child_link:
        return np.asarray(point.position)
    return np.asarray(_on_moving_link(point.position[None], model, value)[0])


def outline(points: Array, position: Array, quaternion: Array) -> Array:
    """Return the convex outline (N, 2), m, of a body seen from above, counter-clockwise.

    Args:
        points: (N, 3) points of the body in its frame, m.
        position: (3,) position of the body in the world frame, m.
        quaternion: (4,) orientation of the body in the world frame, (w, x, y, z).
    """
    seen = (Rotation.from_quat(quaternion, scalar_first=True).apply(points) + position)[:, :2]
    return np.asarray(seen[ConvexHull(seen).vertices], dtype=np.float64)


def square(center: Array, half: float) -> Array:
    """Return the corners (4, 2) of a square, counter-clockwise."""
    return np.asarray(center[:2] + half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]))


def gap_between(first: Array, second: Array) -> float:
    """Return the gap (m) between two convex outlines, negative if they overlap.

    The gap is the largest gap along an edge's normal.

    Args:
        first, second: (N, 2) and (M, 2) corners in m, counter-clockwise.
    """
    return max(_beyond_an_edge(first, second), _beyond_an_edge(second, first))


def _beyond_an_edge(of: Array, other: Array) -> float:
    edges = np.roll(of, -1, axis=0) - of
    outward = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.linalg.norm(edges, axis=1, keepdims=True)
    nearest = (other @ outward.T).min(axis=0)
    return float(np.max(nearest - np.sum(of * outward, axis=1)))


def _on_moving_link(points: Array, model: ArticulatedObject, value: float) -> Array:
    """Transform points (N, 3) from the moving link's frame to the root frame at joint value ``value`` (rad or m)."""
    return transform(model.joint.T_root_child_at(value), points)

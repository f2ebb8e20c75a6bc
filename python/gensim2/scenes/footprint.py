"""Outlines of objects seen from above, their separation, and the height of their lowest point."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from gensim2.objects import RigidObject
from gensim2.objects.shapes import transform
from gensim2.objects.types import BODY, ArticulatedObject

Array = npt.NDArray[np.float64]

JOINT_SAMPLES = 13


def hulls_in_root(model: ArticulatedObject | RigidObject, value: float) -> list[Array]:
    """Convex parts, each (N, 3) m in the root frame, where the joint stands at ``value`` (a rigid object has none)."""
    if isinstance(model, RigidObject):
        return list(model.hulls[BODY])
    moving = model.joint.child_link
    still = [hull for link, hulls in model.hulls.items() if link != moving for hull in hulls]
    return still + [_on_moving_link(hull, model, value) for hull in model.hulls.get(moving, ())]


def swept_points(model: ArticulatedObject | RigidObject) -> Array:
    """(N, 3) m in the root frame: corners of the hull of all that the object fills, anywhere in its joint's range."""
    if isinstance(model, RigidObject):
        values = [0.0]
    else:
        values = list(np.linspace(model.joint.lower, model.joint.upper, JOINT_SAMPLES))
    points = np.concatenate([hull for value in values for hull in hulls_in_root(model, value)])
    return np.asarray(points[ConvexHull(points).vertices], dtype=np.float64)


def lowest_of_moving_link(model: ArticulatedObject, position: Array, quaternion: Array) -> float:
    """Height in the world (m) of the lowest point of what the joint moves, anywhere in its range.

    Args:
        position: (3,) of the root in the world, m.
        quaternion: (4,) of the root in the world, (w, x, y, z).
    """
    hulls = model.hulls.get(model.joint.child_link, ())
    if not hulls:
        return float("inf")
    points = np.concatenate(hulls)
    up = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()[2]
    values = np.linspace(model.joint.lower, model.joint.upper, JOINT_SAMPLES)
    return float(position[2]) + min(float((_on_moving_link(points, model, value) @ up).min()) for value in values)


def keypoint_in_root(model: ArticulatedObject, name: str, value: float) -> Array:
    """(3,) m in the root frame: a keypoint where the joint stands at ``value`` (rad or m)."""
    point = model.keypoints[name]
    if point.link != model.joint.child_link:
        return np.asarray(point.position)
    return np.asarray(_on_moving_link(point.position[None], model, value)[0])


def outline(points: Array, position: Array, quaternion: Array) -> Array:
    """(N, 2) m: corners of the convex outline from above, counter-clockwise, of (N, 3) points of a body at a pose.

    Args:
        points: in the body's frame.
        position: (3,) of the body in the world.
        quaternion: (4,) of the body in the world, (w, x, y, z).
    """
    seen = (Rotation.from_quat(quaternion, scalar_first=True).apply(points) + position)[:, :2]
    return np.asarray(seen[ConvexHull(seen).vertices], dtype=np.float64)


def square(center: Array, half: float) -> Array:
    """(4, 2) corners, counter-clockwise."""
    return np.asarray(center[:2] + half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]))


def keep_apart(first: Array, second: Array, gap: float) -> bool:
    """Whether a strip of the width ``gap`` (m), parallel to an edge of one of two convex outlines, parts them."""
    return gap_between(first, second) >= gap


def gap_between(first: Array, second: Array) -> float:
    """Width (m) of the widest strip, parallel to an edge of one of two convex outlines, that parts them.

    Below 0 they overlap.

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
    """(N, 3) points of the moving link's frame in the root frame, where the joint stands at ``value`` (rad or m)."""
    return transform(model.joint.T_root_child_at(value), points)

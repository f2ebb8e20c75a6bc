"""What can be said of an object's soundness from its geometry alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

from gensim2.assets.shapes import pose, transform
from gensim2.assets.types import Instance

Array = npt.NDArray[np.float64]

OPENNESS = (0.0, 0.25, 0.5, 0.75, 1.0)
OVERLAP = 1.0  # mm of the moving link inside the body, outside the hinge
HINGE = 0.012  # m around the axis that counts as hinge
BASE_GAP = 1.0  # mm between the lowest point and the table
SURFACE_GAP = 10.0  # mm between a surface keypoint and its link
MASS = (0.02, 80.0)  # kg
PUSH = 40.0  # N at the keypoint to overcome friction
MOST_HULLS = 64  # a link
FREE = ("above", "inside", "base")  # parts of the names of keypoints in free space
SAMPLE_SPACING = 0.006  # m between points that stand for a hull's surface


@dataclass(frozen=True)
class Finding:
    """One check that an object does not pass: a value beyond its limit."""

    check: str
    value: float | str
    limit: float | str


def planes_of(hull: Array) -> Array:
    """(M, 4) outward planes of the hull of (N, 3) points."""
    return np.asarray(np.unique(np.round(ConvexHull(hull).equations, 9), axis=0))


def surface_samples(hull: Array, spacing: float = SAMPLE_SPACING) -> Array:
    """Points on the surface of the hull of (N, 3) points, corners included."""
    corners = hull[ConvexHull(hull).simplices]
    samples = [hull]
    for triangle in corners:
        n = int(np.ceil(np.linalg.norm(triangle - np.roll(triangle, 1, axis=0), axis=1).max() / spacing))
        i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
        u, v = i[i + j <= n] / n, j[i + j <= n] / n
        samples.append(np.stack([1 - u - v, u, v], axis=1) @ triangle)
    return np.concatenate(samples)


def link_pose(instance: Instance, openness: float) -> Array:
    """(4, 4) moving link in the root frame at an openness."""
    joint = instance.joint
    q = joint.lower + openness * (joint.upper - joint.lower)
    axis = joint.T_root_child[:3, :3].T @ joint.axis
    motion = pose(q * axis) if joint.type == "prismatic" else pose(axis=axis, angle=q)
    return np.asarray(joint.T_root_child @ motion)


@dataclass(frozen=True)
class Block:
    """A convex hull ready for queries: corners of its bounding box, outward planes (M, 4)."""

    low: Array
    high: Array
    planes: Array

    @staticmethod
    def of(hull: Array) -> Block:
        return Block(hull.min(axis=0), hull.max(axis=0), planes_of(hull))


def depth_inside(points: Array, blocks: list[Block]) -> Array:
    """(K,) how deep points lie inside the deepest of several hulls; 0 outside of all."""
    deepest = np.zeros(len(points))
    for block in blocks:
        near = np.flatnonzero(((points > block.low) & (points < block.high)).all(axis=1))
        if len(near):
            inside = -(points[near] @ block.planes[:, :3].T + block.planes[:, 3]).max(axis=1)
            deepest[near] = np.maximum(deepest[near], inside)
    return deepest


def overlap(instance: Instance) -> float:
    """Deepest that the moving link lies in the body at any of ``OPENNESS``, metres, outside the hinge."""
    joint = instance.joint
    body = next((list(h) for link, h in instance.hulls.items() if link != joint.child_link), [])
    moving = list(instance.hulls[joint.child_link])
    if not body or not moving:
        return 0.0
    of_body = np.asarray(np.concatenate([surface_samples(h) for h in body]), float)
    of_moving = np.asarray(np.concatenate([surface_samples(h) for h in moving]), float)
    body_blocks, moving_blocks = ([Block.of(h) for h in hulls] for hulls in (body, moving))
    worst = 0.0
    for share in OPENNESS:
        T = link_pose(instance, share)
        for points, blocks, back in (
            (transform(T, of_moving), body_blocks, np.eye(4)),
            (of_body, moving_blocks, np.asarray(np.linalg.inv(T), float)),
        ):
            kept = points
            if joint.type == "revolute":
                kept = points[np.linalg.norm(np.cross(points - joint.origin, joint.axis), axis=1) > HINGE]
            if len(kept):
                worst = max(worst, float(depth_inside(transform(back, kept), blocks).max()))
    return worst


def distance_to_link(instance: Instance, name: str) -> float:
    """Distance in metres of a keypoint from its link's hulls, 0 inside; the least distance to their surface samples."""
    keypoint = instance.keypoints[name]
    hulls = list(instance.hulls.get(keypoint.link, ()))
    if not hulls:
        return float("inf")
    point = keypoint.position[None]
    if float(depth_inside(point, [Block.of(h) for h in hulls])[0]) > 0:
        return 0.0
    samples = np.concatenate([surface_samples(h, 0.004) for h in hulls])
    return float(np.linalg.norm(samples - point, axis=1).min())


def world_rotation(instance: Instance) -> Array:
    """(3, 3) root to world of the default placement."""
    return instance.placement.rotation


def geometric_findings(instance: Instance) -> list[Finding]:
    """Checks that need no physics, and what the reader noted."""
    joint = instance.joint
    found = [Finding("note", warning, "none") for warning in instance.warnings]

    def at_most(check: str, value: float, limit: float) -> None:
        if not value <= limit:
            found.append(Finding(check, round(value, 4), limit))

    for link, hulls in instance.hulls.items():
        at_most(f"hulls of {link}", len(hulls), MOST_HULLS)
    at_most("overlap, mm", 1000 * overlap(instance), OVERLAP)
    R, position = world_rotation(instance), instance.placement.position
    still = [h for link, hulls in instance.hulls.items() if link != joint.child_link for h in hulls]
    lowest = np.inf
    head = (
        "articulated_object_head" if "articulated_object_head" in instance.keypoints else next(iter(instance.keypoints))
    )
    for share in OPENNESS:
        T = link_pose(instance, share)
        points = np.concatenate(still + [transform(T, h) for h in instance.hulls[joint.child_link]])
        lowest = min(lowest, float((points @ R.T)[:, 2].min()) + float(position[2]))
    at_most("base above the table, mm", 1000 * abs(lowest), BASE_GAP)
    for name in instance.keypoints:
        if not any(word in name for word in FREE):
            at_most(f"{name} from its link, mm", 1000 * distance_to_link(instance, name), SURFACE_GAP)
        else:
            at_most(f"{name} inside its link, mm", 1000 * _depth_of_free_point(instance, name), 0.0)
    if not MASS[0] <= instance.mass <= MASS[1]:
        found.append(Finding("mass, kg", round(instance.mass, 3), f"{MASS[0]}..{MASS[1]}"))
    lever = instance.lever_arm(head) if joint.type == "revolute" else 1.0
    at_most("push at the keypoint, N", joint.friction / max(lever, 1e-3), PUSH)
    return found


def _depth_of_free_point(instance: Instance, name: str) -> float:
    """How deep a free-space keypoint lies in its own link's hulls, metres; 0 where it is clear."""
    keypoint = instance.keypoints[name]
    hulls = instance.hulls.get(keypoint.link, ())
    if not hulls:
        return 0.0
    return float(depth_inside(keypoint.position[None], [Block.of(h) for h in hulls])[0])

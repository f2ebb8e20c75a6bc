"""Determine from measurements why a step did not meet its criterion."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gensim2.core.arrays import Array
from gensim2.rollout.motion import change
from gensim2.rollout.record import Cause
from gensim2.tasks.criteria import (
    ArticulatedBetween,
    ArticulatedClosed,
    ArticulatedOpen,
    DistanceArticulatedRigid,
    DistanceGripperArticulated,
    RigidMoved,
    RigidOnRigid,
)
from gensim2.tasks.measurement import Measurement
from gensim2.tasks.spec import HAND, Step

LEAST_TRAVEL = 0.05
"""Minimum change of openness that shows that the hand has gripped the handle."""

LEFT_BEHIND = 0.03
"""Maximum distance (m) that a grasped object may shift in the hand."""

LEAST_OPENING = 0.002
"""Minimum distance between the pads, and minimum change of this distance, at which the hand counts as open, m."""

LIFTED = 0.01
"""Height (m) above its initial position at which an object counts as lifted."""

SLIPPED = 0.08
"""Distance (m) that the hand moves along the object's path after the object has stopped; longer than a retreat."""

DRIFTED = 0.005
"""Distance (m) above which an object counts as moved before the actuation pose."""


Surfaces = Mapping[str, Sequence[Array]]
"""Convex hulls, each (N, 3) vertices (m) in the world at the end of the episode, by object."""


def fault_of_criterion(
    step: Step, measured: Sequence[Measurement], at_actuation: Measurement | None, surfaces: Surfaces
) -> tuple[Cause, dict[str, Any]] | None:
    """Return the fault that explains why a step's criteria are not met; None if the measurements show no fault.

    Args:
        step: step to diagnose.
        measured: measurements while the step was executed.
        at_actuation: measurement at the step's actuation pose; None if unknown.
        surfaces: surfaces of the objects, for measuring the distance between the hand and an object that it did not
            move.
    """
    if step.tool == HAND and (moved := drift(measured, at_actuation, step.object)) is not None:
        return Cause.OBJECT_DRIFTED, {"distance": moved}
    if step.tool != HAND and (distance := was_lost(measured, step.tool)) is not None:
        return Cause.GRASP_LOST, {"distance": distance}
    start = measured[0]
    for criterion in step.done:
        if criterion.holds(measured[-1]):
            continue
        if isinstance(criterion, ArticulatedOpen | ArticulatedClosed):
            sign = 1.0 if isinstance(criterion, ArticulatedOpen) else -1.0
            return _of_joint(criterion.object, sign, measured, surfaces)
        if isinstance(criterion, DistanceArticulatedRigid):
            return Cause.PLACED_BESIDE, {
                "distance": distance_apart(measured[-1], criterion.articulated, criterion.rigid)
            }
        if isinstance(criterion, ArticulatedBetween):
            sign = math.copysign(1.0, criterion.low - start.openness[criterion.object])
            return _of_joint(criterion.object, sign, measured, surfaces)
        if isinstance(criterion, RigidOnRigid):
            return Cause.PLACED_BESIDE, {"distance": _apart(measured[-1], criterion.rigid, criterion.support)}
        if isinstance(criterion, RigidMoved):
            return _of_push(criterion.rigid, measured, surfaces)
        name = criterion.articulated if isinstance(criterion, DistanceGripperArticulated) else criterion.rigid
        if name in measured[0].poses and (moved := change(measured[0], measured[-1], name).distance) > LEFT_BEHIND:
            return Cause.OBJECT_DRIFTED, {"distance": moved}
    return None


def drift(measured: Sequence[Measurement], at_actuation: Measurement | None, name: str) -> float | None:
    """Return how far a rigid object moved before the actuation pose, metres, or None if it moved at most
    ``DRIFTED``.
    """
    if at_actuation is None or name not in at_actuation.poses:
        return None
    moved = change(measured[0], at_actuation, name).distance
    return moved if moved > DRIFTED else None


def was_left_behind(measured: Sequence[Measurement], name: str) -> float | None:
    """Return the distance (m) by which the hand moved away from an object; None if the object moved with the hand."""
    if measured[-1].finger_opening < LEAST_OPENING:
        return _distances(measured[-1:], name)[-1]
    distances = _distances(measured, name)
    farther = distances[-1] - min(distances)
    return farther if farther > LEFT_BEHIND else None


def was_lifted(measured: Sequence[Measurement], name: str) -> bool:
    """Return whether a rigid object was lifted above its initial height, and was therefore in the hand."""
    heights = [float(instant.poses[name][2]) for instant in measured]
    return max(heights) > heights[0] + LIFTED


def was_lost(measured: Sequence[Measurement], name: str) -> float | None:
    """Return how far an object slipped in the hand, metres, or None if it did not slip, or after its release."""
    distances = _distances(measured, name)
    let_go = released(measured)
    for distance, instant in zip(distances, measured, strict=True):
        if instant is let_go:
            return None
        if distance > distances[0] + LEFT_BEHIND:
            return distance - distances[0]
    return None


def released(measured: Sequence[Measurement]) -> Measurement | None:
    """Return the first measurement after the fingers opened; None if the fingers stayed closed."""
    opening = measured[0].finger_opening + LEAST_OPENING
    return next((instant for instant in measured if instant.finger_opening > opening), None)


def distance_apart(measured: Measurement, first: str, second: str) -> float:
    """Return the horizontal distance (m) between the measured points of two objects."""
    return float(np.linalg.norm((measured.point(first) - measured.point(second))[:2]))


def _apart(measured: Measurement, first: str, second: str) -> float:
    """Return the horizontal distance (m) between the centres of two rigid objects."""
    return float(np.linalg.norm((measured.poses[first] - measured.poses[second])[:2]))


def _of_push(name: str, measured: Sequence[Measurement], surfaces: Surfaces) -> tuple[Cause, dict[str, Any]]:
    """Return the fault of a step that should have moved a rigid object."""
    way = float(np.linalg.norm((measured[-1].poses[name] - measured[0].poses[name])[:2]))
    if way < DRIFTED:
        return Cause.NO_CONTACT, {"distance": way, "nearest": _to_surface(measured, surfaces[name])}
    return Cause.STOPPED_SHORT, {"distance": way}


def _of_joint(
    name: str, sign: float, measured: Sequence[Measurement], surfaces: Surfaces
) -> tuple[Cause, dict[str, Any]]:
    course = [sign * (instant.openness[name] - measured[0].openness[name]) for instant in measured]
    numbers = {"travelled": course[-1], "furthest": max(course), "openness": measured[-1].openness[name]}
    if course[-1] < -LEAST_TRAVEL:
        return Cause.WRONG_WAY, numbers
    if max(course) < LEAST_TRAVEL:
        return Cause.NO_CONTACT, numbers | {"nearest": _to_surface(measured, surfaces[name])}
    slip = _slip(name, course, measured)
    if slip > SLIPPED:
        return Cause.CONTACT_SLIPPED, numbers | {"slip": slip}
    return Cause.STOPPED_SHORT, numbers


def _slip(name: str, course: Sequence[float], measured: Sequence[Measurement]) -> float:
    """Return how far the hand moved on in the object's direction after the object had stopped, metres."""
    stopped = next(i for i, travelled in enumerate(course) if travelled > max(course) - 0.1 * LEAST_TRAVEL)
    began = next(i for i, travelled in enumerate(course) if travelled > 0.5 * course[stopped])
    hand = np.stack([_hand(instant) for instant in measured])
    points = [np.stack(list(measured[i].keypoints[name].values())) for i in (began, stopped)]
    nearest = int(np.argmin(np.linalg.norm(points[1] - hand[stopped], axis=1)))
    way = points[1][nearest] - points[0][nearest]
    length = float(np.linalg.norm(way))
    return 0.0 if length < 1e-3 else float(((hand[stopped:] - hand[stopped]) @ (way / length)).max())


def _distances(measured: Sequence[Measurement], name: str) -> list[float]:
    """Return, for each measurement, the distance (m) from the hand to the nearest keypoint of an object."""
    return [
        float(np.linalg.norm(np.stack(list(instant.keypoints[name].values())) - _hand(instant), axis=1).min())
        for instant in measured
    ]


def _to_surface(measured: Sequence[Measurement], hulls: Sequence[Array]) -> float:
    """Return the smallest distance (m) between the hand and an object's surface; 0 if the hand was inside a hull."""
    import trimesh
    from scipy.spatial import ConvexHull

    # A few hundred positions of the hand are enough, because the hand moves little between two measurements.
    hands = np.stack([_hand(instant) for instant in measured[:: 1 + len(measured) // 400]])
    nearest = math.inf
    for hull in hulls:
        shape = ConvexHull(hull)
        if (hands @ shape.equations[:, :3].T + shape.equations[:, 3] <= 0.0).all(axis=1).any():
            return 0.0
        for triangle in hull[shape.simplices]:
            points = trimesh.triangles.closest_point(np.broadcast_to(triangle, (len(hands), 3, 3)), hands)
            nearest = min(nearest, float(np.linalg.norm(points - hands, axis=1).min()))
    return nearest


def _hand(measured: Measurement) -> Array:
    """Return the point (3,) between the fingertips, the first keypoint of the gripper."""
    return next(iter(measured.gripper.values()))

"""Faults of a step whose criterion did not come true, from the measurements of its turn."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

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

Array = npt.NDArray[np.float64]

LEAST_TRAVEL = 0.05
"""Openness by which a joint must have moved for the hand to have had hold of it."""

LEFT_BEHIND = 0.03
"""Metres by which an object that the hand holds may shift in it."""

LEAST_OPENING = 0.002
"""Metres between the pads, or by which they open, that are none."""

LIFTED = 0.01
"""Metres above the place where it lay at which an object has been taken up."""

SLIPPED = 0.08
"""Metres that the hand goes on in the object's direction after it stopped: more than it backs off by."""

DRIFTED = 0.005
"""Metres by which an object moves before the hand is at its actuation pose."""


def fault_of_criterion(
    step: Step, measured: Sequence[Measurement], at_actuation: Measurement | None
) -> tuple[Cause, dict[str, Any]] | None:
    """Why a step's criteria were not true; None where the measurements do not say.

    Args:
        step: whose turn it was.
        measured: in its turn.
        at_actuation: measured when the hand was at the step's actuation pose, where anybody knows.
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
            return _of_joint(criterion.object, sign, measured)
        if isinstance(criterion, DistanceArticulatedRigid):
            return Cause.PLACED_BESIDE, {
                "distance": distance_apart(measured[-1], criterion.articulated, criterion.rigid)
            }
        if isinstance(criterion, ArticulatedBetween):
            return _of_joint(
                criterion.object, math.copysign(1.0, criterion.low - start.openness[criterion.object]), measured
            )
        if isinstance(criterion, RigidOnRigid):
            return Cause.PLACED_BESIDE, {"distance": _apart(measured[-1], criterion.rigid, criterion.support)}
        if isinstance(criterion, RigidMoved):
            return _of_push(criterion.rigid, measured)
        name = criterion.articulated if isinstance(criterion, DistanceGripperArticulated) else criterion.rigid
        if name in measured[0].poses and (moved := change(measured[0], measured[-1], name).distance) > LEFT_BEHIND:
            return Cause.OBJECT_DRIFTED, {"distance": moved}
    return None


def drift(measured: Sequence[Measurement], at_actuation: Measurement | None, name: str) -> float | None:
    """Metres that a rigid object went before the hand was at its actuation pose; None: it stayed, or it is unknown."""
    if at_actuation is None or name not in at_actuation.poses:
        return None
    moved = change(measured[0], at_actuation, name).distance
    return moved if moved > DRIFTED else None


def was_left_behind(measured: Sequence[Measurement], name: str) -> float | None:
    """Metres that the hand ended farther from a rigid object than it had been, or None where it took it along."""
    if measured[-1].finger_opening < LEAST_OPENING:
        return _distances(measured[-1:], name)[-1]
    distances = _distances(measured, name)
    farther = distances[-1] - min(distances)
    return farther if farther > LEFT_BEHIND else None


def was_lifted(measured: Sequence[Measurement], name: str) -> bool:
    """Whether a rigid object was once higher than it lay, as only the hand can have had it."""
    heights = [float(instant.poses[name][2]) for instant in measured]
    return max(heights) > heights[0] + LIFTED


def was_lost(measured: Sequence[Measurement], name: str) -> float | None:
    """Metres that a held object was away from where the hand had it, or None where it was not, or was released."""
    distances = _distances(measured, name)
    let_go = released(measured)
    for distance, instant in zip(distances, measured, strict=True):
        if instant is let_go:
            return None
        if distance > distances[0] + LEFT_BEHIND:
            return distance - distances[0]
    return None


def released(measured: Sequence[Measurement]) -> Measurement | None:
    """The instant at which the fingers opened, that held something at the first; None: they did not."""
    opening = measured[0].finger_opening + LEAST_OPENING
    return next((instant for instant in measured if instant.finger_opening > opening), None)


def distance_apart(measured: Measurement, first: str, second: str) -> float:
    """Metres between the measured points of two objects, horizontally."""
    return float(np.linalg.norm((measured.point(first) - measured.point(second))[:2]))


def _apart(measured: Measurement, first: str, second: str) -> float:
    """Metres between the middles of two rigid objects, horizontally."""
    return float(np.linalg.norm((measured.poses[first] - measured.poses[second])[:2]))


def _of_push(name: str, measured: Sequence[Measurement]) -> tuple[Cause, dict[str, Any]]:
    """Of a rigid object that was to be elsewhere."""
    way = float(np.linalg.norm((measured[-1].poses[name] - measured[0].poses[name])[:2]))
    if way < DRIFTED:
        return Cause.NO_CONTACT, {"distance": way, "nearest": min(_distances(measured, name))}
    return Cause.STOPPED_SHORT, {"distance": way}


def _of_joint(name: str, sign: float, measured: Sequence[Measurement]) -> tuple[Cause, dict[str, Any]]:
    course = [sign * (instant.openness[name] - measured[0].openness[name]) for instant in measured]
    numbers = {"travelled": course[-1], "furthest": max(course), "openness": measured[-1].openness[name]}
    if course[-1] < -LEAST_TRAVEL:
        return Cause.WRONG_WAY, numbers
    if max(course) < LEAST_TRAVEL:
        return Cause.NO_CONTACT, numbers | {"nearest": min(_distances(measured, name))}
    slip = _slip(name, course, measured)
    if slip > SLIPPED:
        return Cause.CONTACT_SLIPPED, numbers | {"slip": slip}
    return Cause.STOPPED_SHORT, numbers


def _slip(name: str, course: Sequence[float], measured: Sequence[Measurement]) -> float:
    """Metres that the hand went on, in the direction in which the object had gone, once that went no further."""
    stopped = next(i for i, travelled in enumerate(course) if travelled > max(course) - 0.1 * LEAST_TRAVEL)
    began = next(i for i, travelled in enumerate(course) if travelled > 0.5 * course[stopped])
    hand = np.stack([_hand(instant) for instant in measured])
    points = [np.stack(list(measured[i].keypoints[name].values())) for i in (began, stopped)]
    nearest = int(np.argmin(np.linalg.norm(points[1] - hand[stopped], axis=1)))
    way = points[1][nearest] - points[0][nearest]
    length = float(np.linalg.norm(way))
    return 0.0 if length < 1e-3 else float(((hand[stopped:] - hand[stopped]) @ (way / length)).max())


def _distances(measured: Sequence[Measurement], name: str) -> list[float]:
    """Metres from the hand to the nearest keypoint of an object, by instant."""
    return [
        float(np.linalg.norm(np.stack(list(instant.keypoints[name].values())) - _hand(instant), axis=1).min())
        for instant in measured
    ]


def _hand(measured: Measurement) -> Array:
    """(3,) between the fingertips: the first keypoint of the gripper."""
    return next(iter(measured.gripper.values()))

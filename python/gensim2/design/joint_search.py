"""Enumerate and vary the strategies that move one joint.

Each strategy follows from an alignment: a contact point on the object, an approach direction and a motion of the hand.

Alignments depend on the joint type, the moving keypoints, the distance of these keypoints from the axis, and the goal,
but not on the class.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, Literal

from gensim2.core import seeding
from gensim2.design.affordance import Affordance
from gensim2.design.manipulation import Axis, Direction, Manipulation, Motion

#: Openness at which commanded motions end. The values lie beyond the joint limits, because pushed parts lag behind the
#: hand.
OPENED, CLOSED_UP = 1.05, -0.1

_HALF = math.sqrt(0.5)
_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_NAMES = "xyz"


def _directions() -> list[Direction]:
    """Return the approach directions.

    18 of them are along or between the axes of the joint frame, and 3 are in the world frame, for objects on a table.
    """
    found = []
    for index, axis in enumerate(_AXES):
        for sign in (1.0, -1.0):
            vector = (sign * axis[0], sign * axis[1], sign * axis[2])
            found.append(Direction(f"{'+' if sign > 0 else '-'}{_NAMES[index]}", "joint", vector))
    for i, j in itertools.combinations(range(3), 2):
        for a, b in itertools.product((1.0, -1.0), repeat=2):
            v = [0.0, 0.0, 0.0]
            v[i], v[j] = a * _HALF, b * _HALF
            name = f"{'+' if a > 0 else '-'}{_NAMES[i]}{'+' if b > 0 else '-'}{_NAMES[j]}"
            found.append(Direction(name, "joint", (v[0], v[1], v[2])))
    found.append(Direction("straight down", "world", (0.0, 0.0, -1.0)))
    found.append(Direction("forward and down", "world", (_HALF, 0.0, -_HALF)))
    found.append(Direction("forward", "world", (1.0, 0.0, 0.0)))
    return found


DIRECTIONS = tuple(_directions())


#: Alignments that often work for prismatic joints. Each has an approach direction, followed by ``gripper``, ``roll``,
#: ``behind``, ``inset``, ``motion`` and ``tolerance`` of a :class:`Manipulation`.
LIKELY: tuple[tuple[str, Literal["closed", "grasp"], Axis | None, float, float, Motion, float], ...] = (
    ("straight down", "grasp", "z", 0.0, 0.0, "follow_joint_to", 0.15),
    ("straight down", "closed", None, 0.0, 0.0, "trace_joint_to", 0.05),
    ("+x", "closed", None, 0.025, 0.015, "follow_joint_to", 0.5),
    ("forward", "closed", None, 0.025, 0.0, "trace_joint_to", 0.5),
)


def likely(thing: Affordance, opening: bool, goal: float) -> list[Manipulation]:
    """Return the alignments to try before random alignments. They use the keypoint farthest from the joint axis."""
    if thing.joint_type != "prismatic" or not thing.lever_arms:
        return []
    named = {direction.name: direction for direction in DIRECTIONS}
    return [
        Manipulation(
            keypoint=max(thing.lever_arms, key=lambda name: thing.lever_arms[name]),
            gripper=gripper,
            approach=named[name],
            roll=roll,
            behind=behind,
            inset=inset,
            retreat=0.1,
            motion=motion,
            goal_openness=goal,
            tolerance=tolerance,
            opening=opening,
        )
        for name, gripper, roll, behind, inset, motion, tolerance in LIKELY
    ]


def sample(thing: Affordance, opening: bool, goal: float, count: int, seed: int, what: str) -> list[Manipulation]:
    """Return all alignments of a joint, or a random selection of ``count`` alignments if there are more.

    Args:
        thing: object class with the joint to move.
        goal: openness at which the motions end.
        count: maximum number of alignments.
        seed, what: seed of the random selection, and a name that makes the selection independent of other selections.
    """
    found = list(alignments(thing, opening, goal))
    if len(found) <= count:
        return found
    chosen = seeding.rng(seed, what).choice(len(found), count, replace=False)
    return [found[index] for index in sorted(chosen.tolist())]


def vary(parent: Manipulation, halfway: bool, generator: Any) -> Manipulation:
    """Return a copy of ``parent`` with random offsets, retreat, tolerance and motion, and with a random final openness.

    Args:
        halfway: whether the goal lies between the joint limits; the openness at the end is then kept.
        generator: random number generator.
    """
    step = 1.0 if parent.opening else -1.0
    further = 0.0 if halfway else step * generator.uniform(-0.1, 0.2)
    return replace(
        parent,
        behind=round_to(max(0.0, parent.behind + generator.uniform(-0.02, 0.03))),
        inset=round_to(max(-0.01, parent.inset + generator.uniform(-0.02, 0.03))),
        retreat=round_to(min(0.16, max(0.05, parent.retreat + generator.uniform(-0.04, 0.04)))),
        goal_openness=round_to(parent.goal_openness + further, 0.05),
        tolerance=float(generator.choice([0.05, 0.15, 0.3, 0.5])),
        motion="trace_joint_to" if generator.random() < 0.3 else parent.motion,
    )


def manipulation_from(provenance: dict[str, Any]) -> Manipulation:
    """Return the manipulation that ``Manipulation.provenance()`` stored."""
    values = dict(provenance)
    approach = values.pop("approach")
    return Manipulation(approach=Direction(approach["name"], approach["frame"], tuple(approach["vector"])), **values)


def round_to(value: float, step: float = 0.005) -> float:
    """Round to a multiple of ``step``, so that solver configs stay readable."""
    return round(round(value / step) * step, 6)


def alignments(thing: Affordance, opening: bool, goal: float) -> Iterator[Manipulation]:
    """Yield all alignments on a grid of directions, offsets and motions; for the arguments see :func:`sample`."""
    longest = max(thing.lever_arms.values(), default=0.0)
    for keypoint in thing.lever_arms:
        if longest and thing.lever_arms[keypoint] < 0.3 * longest:
            continue  # a contact this close to the hinge cannot move the part
        for direction in DIRECTIONS:
            yield from _pushes(keypoint, direction, opening, goal)
            yield from _grasps(keypoint, direction, opening, goal)


def _pushes_from_the_wrong_side(direction: Direction, opening: bool) -> bool:
    """Return whether the fingers point against the motion of the part. The hand would then block the part."""
    along = direction.vector[1] if direction.frame == "joint" else 0.0
    return (along if opening else -along) < -0.5


def _pushes(keypoint: str, direction: Direction, opening: bool, goal: float) -> Iterator[Manipulation]:
    """Yield pushes with closed fingers; the solver chooses the roll angle, because closed fingers are nearly round."""
    if _pushes_from_the_wrong_side(direction, opening):
        return
    motions: Sequence[Motion] = ("follow_joint_to", "trace_joint_to")
    for (behind, inset), motion in itertools.product(((0.0, 0.0), (0.03, 0.0), (0.03, 0.03)), motions):
        yield Manipulation(
            keypoint=keypoint,
            gripper="closed",
            approach=direction,
            roll=None,
            behind=behind,
            inset=inset,
            retreat=0.1,
            motion=motion,
            goal_openness=goal,
            tolerance=0.3,
            opening=opening,
        )


def _grasps(keypoint: str, direction: Direction, opening: bool, goal: float) -> Iterator[Manipulation]:
    """Yield grasps with the fingertips' line perpendicular to a joint axis, so that they do not miss thin parts."""
    axes: Sequence[Axis] = ("x", "y", "z")
    for roll, inset in itertools.product(axes, (0.0, 0.015)):
        if direction.frame == "joint" and abs(direction.vector["xyz".index(roll)]) > 0.9:
            continue  # only an axis orthogonal to the approach direction determines the roll of the hand
        yield Manipulation(
            keypoint=keypoint,
            gripper="grasp",
            approach=direction,
            roll=roll,
            behind=0.0,
            inset=inset,
            retreat=0.1,
            motion="follow_joint_to",
            goal_openness=goal,
            tolerance=0.15,
            opening=opening,
        )

"""Describe criteria, places and ranges of tasks in words, for pages and the terminal."""

from __future__ import annotations

import math

from gensim2.tasks.criteria import (
    ArticulatedBetween,
    ArticulatedClosed,
    ArticulatedOpen,
    Criterion,
    RigidLifted,
    RigidMoved,
    RigidOnRigid,
)
from gensim2.tasks.spec import TABLE, ObjectSpec, Offset

_WAYS = {"away": "away from the robot", "closer": "towards the robot", "left": "to the left", "right": "to the right"}


def criterion_in_words(criterion: Criterion) -> str:
    """Describe a criterion: ``"openness of the drawer above 0.8"``."""
    if isinstance(criterion, ArticulatedOpen | ArticulatedClosed):
        side = "above" if isinstance(criterion, ArticulatedOpen) else "below"
        return f"openness of the {_said(criterion.object)} {side} {criterion.threshold:g}"
    if isinstance(criterion, ArticulatedBetween):
        return f"openness of the {_said(criterion.object)} between {criterion.low:g} and {criterion.high:g}"
    if isinstance(criterion, RigidLifted):
        return f"{_said(criterion.rigid)} {100 * criterion.height:g} cm higher than it was"
    if isinstance(criterion, RigidMoved):
        return f"{_said(criterion.rigid)} {100 * criterion.distance:g} cm further {_WAYS[criterion.direction]}"
    if isinstance(criterion, RigidOnRigid):
        return f"{_said(criterion.rigid)} on the {_said(criterion.support)}"
    first, second = criterion.objects if len(criterion.objects) == 2 else ("hand", *criterion.objects)
    return f"{_said(first)} and {_said(second)} within {100 * criterion.threshold:g} cm, seen from above"


def criteria_in_words(criteria: tuple[Criterion, ...]) -> str:
    """Describe several criteria in words; empty without criteria."""
    return " and ".join(criterion_in_words(criterion) for criterion in criteria)


def name_in_words(name: str) -> str:
    """Return a step's or an object's name in words: ``"shut_it"`` becomes ``"shut it"``."""
    return _said(name)


def place_in_words(thing: ObjectSpec) -> str:
    """Describe an object's placement before randomization."""
    where = "on the table" if thing.place.on == TABLE else f"in or on the {_said(thing.place.on)}"
    turned = f", turned by {math.degrees(thing.place.yaw):.0f}°" if thing.place.yaw else ""
    if thing.place.at is None:
        usual = "at its usual place" if thing.place.on == TABLE else "in the middle"
        return f"{where}, {usual}{turned}"
    x, y = thing.place.at
    return f"{where} at ({x:g}, {y:g}) m{turned}"


def randomization_in_words(thing: ObjectSpec, *, with_joint: bool) -> str:
    """Describe an object's randomization ranges.

    Args:
        with_joint: whether the object is articulated, so that its openness is randomized, too.
    """
    drawn = thing.randomization
    parts = [_offset("x", drawn.x), _offset("y", drawn.y), f"yaw up to {math.degrees(drawn.yaw):.0f}°"]
    if with_joint:
        mean = "its usual one" if drawn.openness_mean is None else f"{drawn.openness_mean:g}"
        parts.append(f"openness {mean} ± {drawn.openness_spread:g}")
    return ", ".join(parts)


def _offset(axis: str, given: Offset) -> str:
    low, high = (100 * value for value in given)
    return f"{axis} ± {high:g} cm" if low == -high else f"{axis} {low:+g} to {high:+g} cm"


def _said(name: str) -> str:
    return name.replace("_", " ")

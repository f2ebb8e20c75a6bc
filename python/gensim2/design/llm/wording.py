"""Wording of a brief about a class, for prompts."""

from __future__ import annotations

import math

from gensim2.design.affordance import Affordance
from gensim2.tasks.spec import TaskSpec


def motion(thing: Affordance) -> str:
    """Describe the motion of its joint: ``"a hinge of 110°"``."""
    if thing.joint_type is None or thing.joint_range is None:
        return "rigid"
    low, high = thing.joint_range
    if thing.joint_type == "revolute":
        return f"a hinge of {math.degrees(high - low):.0f}°"
    return f"a slide of {100 * (high - low):.0f} cm"


def size(thing: Affordance) -> str:
    """Its extents as it stands."""
    depth, width, height = (100 * value for value in thing.size)
    return f"{depth:.0f} x {width:.0f} x {height:.0f} cm (deep, wide, high)"


def known_task(task: TaskSpec) -> str:
    """A task that is there, in one line."""
    classes = ", ".join(dict.fromkeys(thing.asset_class for thing in task.objects.values()))
    goal = ", ".join(criterion.type for criterion in task.success)
    return f"{task.name}: {task.description} ({classes}; {goal})"

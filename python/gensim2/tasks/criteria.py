"""When a task counts as done: pure functions of a task spec and what the scene measures."""

from __future__ import annotations

import math

from gensim2.tasks.spec import Criterion, TaskSpec


def holds(criterion: Criterion, openness: float) -> bool:
    """Whether one criterion holds at ``openness`` (may leave 0..1 by the joint's give). NaN never holds."""
    if math.isnan(openness):
        return False
    if criterion.type == "articulated_open":
        return openness > criterion.threshold
    return openness < criterion.threshold


def succeeded(task: TaskSpec, openness: float) -> bool:
    """Whether every criterion of ``task`` holds at ``openness``."""
    return all(holds(criterion, openness) for criterion in task.success)

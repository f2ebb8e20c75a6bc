"""Compute the dense reward of an episode from the criteria of the task's steps and goal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gensim2.tasks.criteria import Criterion, all_hold, nearness
from gensim2.tasks.measurement import Measurement
from gensim2.tasks.spec import TaskSpec

REACHING = 0.2
"""Fraction of a stage's reward that is given for moving the gripper to the stage's object."""
BELOW_GOAL = 0.99
"""Maximum reward before the goal is reached."""


@dataclass(frozen=True)
class Stage:
    """Stage of a task; one stage is rewarded at a time.

    Attributes:
        criteria: criteria that end the stage when all hold.
        object: name of the object to which the gripper should move.
    """

    criteria: tuple[Criterion, ...]
    object: str

    def progress(self, measured: Measurement) -> float:
        """Return the progress of the stage, 0 to 1."""
        points = measured.keypoints[self.object].values()
        away = min(float(np.linalg.norm(tool - point)) for tool in measured.gripper.values() for point in points)
        done = sum(criterion.progress(measured) for criterion in self.criteria) / len(self.criteria)
        return REACHING * nearness(away) + (1.0 - REACHING) * done


def stages_of(task: TaskSpec) -> tuple[Stage, ...]:
    """Return the stages of a task.

    There is one for each step with criteria, and one for the goal if it differs from the criteria of the last step.

    Steps without ``done`` belong to the next stage with criteria. A part of the reward of a stage is for moving the
    gripper to the object of its first step.
    """
    found: list[Stage] = []
    first: str | None = None
    for step in task.steps:
        first = first or step.object
        if step.done:
            found.append(Stage(step.done, first))
            first = None
    if not found or found[-1].criteria != task.success:
        found.append(Stage(task.success, first or task.steps[-1].object))
    return tuple(found)


class StagedReward:
    """Dense reward of an episode, normalized to 0..1: 1 exactly when the goal holds.

    Stages have equal weight and the order of the steps. A finished stage keeps its reward, even if it is reversed
    later.

    Args:
        task: task whose steps and goal are rewarded.
    """

    def __init__(self, task: TaskSpec) -> None:
        self._goal, self._stages, self._stage = task.success, stages_of(task), 0

    def of(self, measured: Measurement) -> float:
        """Return the reward at this instant, and advance to the next stage if the current stage has ended."""
        if all_hold(self._goal, measured):
            return 1.0
        last = len(self._stages) - 1
        while self._stage < last and all_hold(self._stages[self._stage].criteria, measured):
            self._stage += 1
        return min((self._stage + self._stages[self._stage].progress(measured)) / len(self._stages), BELOW_GOAL)

"""Dense reward of an episode, from the criteria of a task's steps and of its goal; free of any simulator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gensim2.tasks.criteria import Criterion, all_hold, nearness
from gensim2.tasks.measurement import Measurement
from gensim2.tasks.spec import TaskSpec

REACHING = 0.2
"""Part of a stage's reward that is paid for bringing the gripper to the stage's object."""
BELOW_GOAL = 0.99
"""Largest reward short of the goal."""


@dataclass(frozen=True)
class Stage:
    """Part of a task that is rewarded at one time.

    Attributes:
        criteria: all must hold for the next stage to begin.
        object: name of what the gripper is to be brought to meanwhile.
    """

    criteria: tuple[Criterion, ...]
    object: str

    def progress(self, measured: Measurement) -> float:
        """Return how near the stage is to its end, 0 to 1."""
        points = measured.keypoints[self.object].values()
        away = min(float(np.linalg.norm(tool - point)) for tool in measured.gripper.values() for point in points)
        done = sum(criterion.progress(measured) for criterion in self.criteria) / len(self.criteria)
        return REACHING * nearness(away) + (1.0 - REACHING) * done


def stages_of(task: TaskSpec) -> tuple[Stage, ...]:
    """Return a task's stages: one a step that must be done, and the goal where it is another than the last step's.

    A step without ``done`` belongs to the stage of the next that has it, which then begins with that step's object.
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
    """Dense reward of one episode, normalised to 0..1: 1 exactly where the goal holds.

    Stages count alike and come in the order of the task's steps. One that has ended is not asked for again, as a later
    one may undo it (a drawer that was opened is closed); what has been earned is kept.

    Args:
        task: whose steps and goal are rewarded.
    """

    def __init__(self, task: TaskSpec) -> None:
        self._goal, self._stages, self._stage = task.success, stages_of(task), 0

    def of(self, measured: Measurement) -> float:
        """Return the reward of this instant, and go on to the next stage where this one has ended."""
        if all_hold(self._goal, measured):
            return 1.0
        last = len(self._stages) - 1
        while self._stage < last and all_hold(self._stages[self._stage].criteria, measured):
            self._stage += 1
        return min((self._stage + self._stages[self._stage].progress(measured)) / len(self._stages), BELOW_GOAL)

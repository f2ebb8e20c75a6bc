"""Describe the goal of a task that a policy was trained on, so that a controller can judge the goal by perception."""

from __future__ import annotations

from typing import Self

from pydantic import BaseModel, ConfigDict, model_validator

from gensim2.tasks.criteria import Criterion
from gensim2.tasks.spec import TaskSpec


class TaskGoal(BaseModel):
    """Objects and success criteria of a task.

    Attributes:
        objects: class of each object, by the object's name in the task.
        success: success criteria, which name objects of the task.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    objects: dict[str, str]
    success: tuple[Criterion, ...]

    @model_validator(mode="after")
    def _criteria_name_objects(self) -> Self:
        for name in (name for each in self.success for name in each.objects):
            if name not in self.objects:
                raise ValueError(f"a success criterion names the object {name!r}, which is not listed under 'objects'")
        return self

    @staticmethod
    def of(task: TaskSpec) -> TaskGoal:
        """Return the goal of a task."""
        return TaskGoal(objects={name: each.asset_class for name, each in task.objects.items()}, success=task.success)

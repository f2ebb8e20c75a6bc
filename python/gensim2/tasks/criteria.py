"""When a step or a task counts as done: a union of small values, each a pure function of a :class:`Measurement`.

The five are the paper's. Distances are horizontal, between measured points: an object's last keypoint, as in the
original; heights are the business of the strict verdict.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from gensim2.tasks.measurement import Measurement

OPEN, CLOSED = 0.8, 0.2
"""Openness beyond which the paper calls a joint open, or closed."""
NEAR = 0.05
"""Horizontal distance (m) within which the paper calls two points together."""

Threshold = Annotated[float, Field(gt=0, lt=1)]


class _Criterion(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class ArticulatedOpen(_Criterion):
    """The object's openness is above ``threshold``."""

    type: Literal["articulated_open"] = "articulated_open"
    object: str
    threshold: Threshold = OPEN

    @property
    def objects(self) -> tuple[str, ...]:
        """Names of the objects that it is about."""
        return (self.object,)

    def holds(self, measured: Measurement) -> bool:
        """Whether it holds; NaN never does."""
        return measured.openness[self.object] > self.threshold


class ArticulatedClosed(_Criterion):
    """The object's openness is below ``threshold``."""

    type: Literal["articulated_closed"] = "articulated_closed"
    object: str
    threshold: Threshold = CLOSED

    @property
    def objects(self) -> tuple[str, ...]:
        """Names of the objects that it is about."""
        return (self.object,)

    def holds(self, measured: Measurement) -> bool:
        """Whether it holds; NaN never does."""
        return measured.openness[self.object] < self.threshold


class DistanceArticulatedRigid(_Criterion):
    """The measured points of an articulated and a rigid object are within ``threshold`` (m), horizontally."""

    type: Literal["distance_articulated_rigidbody"] = "distance_articulated_rigidbody"
    articulated: str
    rigid: str
    threshold: Threshold = NEAR

    @property
    def objects(self) -> tuple[str, ...]:
        """Names of the objects that it is about."""
        return (self.articulated, self.rigid)

    def holds(self, measured: Measurement) -> bool:
        """Whether it holds; NaN never does."""
        between = measured.point(self.articulated)[:2] - measured.point(self.rigid)[:2]
        return math.hypot(*between) < self.threshold


class DistanceGripperRigid(_Criterion):
    """Any keypoint of the gripper is within ``threshold`` (m) of the rigid object's measured point, horizontally."""

    type: Literal["distance_gripper_rigidbody"] = "distance_gripper_rigidbody"
    rigid: str
    threshold: Threshold = NEAR

    @property
    def objects(self) -> tuple[str, ...]:
        """Names of the objects that it is about."""
        return (self.rigid,)

    def holds(self, measured: Measurement) -> bool:
        """Whether it holds; NaN never does."""
        return _from_gripper(measured, self.rigid) < self.threshold


class DistanceGripperArticulated(_Criterion):
    """Any keypoint of the gripper is within ``threshold`` (m) of the articulated object's point, horizontally."""

    type: Literal["distance_gripper_articulated"] = "distance_gripper_articulated"
    articulated: str
    threshold: Threshold = NEAR

    @property
    def objects(self) -> tuple[str, ...]:
        """Names of the objects that it is about."""
        return (self.articulated,)

    def holds(self, measured: Measurement) -> bool:
        """Whether it holds; NaN never does."""
        return _from_gripper(measured, self.articulated) < self.threshold


Criterion = Annotated[
    ArticulatedOpen | ArticulatedClosed | DistanceArticulatedRigid | DistanceGripperRigid | DistanceGripperArticulated,
    Field(discriminator="type"),
]


def all_hold(criteria: tuple[Criterion, ...], measured: Measurement) -> bool:
    """Whether every criterion holds at once; none at all hold."""
    return all(criterion.holds(measured) for criterion in criteria)


def _from_gripper(measured: Measurement, name: str) -> float:
    point = measured.point(name)[:2]
    return min(float(np.hypot(*(place[:2] - point))) for place in measured.gripper.values())

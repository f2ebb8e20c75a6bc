"""Define the success criteria of steps and tasks. Each criterion is a pure function of a :class:`Measurement`.

Five criteria come from the paper. The original GenSim2 uses only horizontal distances of the measured (last) keypoints,
so an object in the air above a box counts as inside it. Here these criteria also check heights and interiors.
``holds_in_paper`` is the original definition, for the verdict ``paper``.

The other criteria check how far a joint is open, or the position of a rigid object, which is the origin of its frame,
near its middle.

Each criterion has the property ``objects`` with the names of the objects that it measures. ``holds`` returns whether
the criterion is met; a criterion with a NaN measurement is never met. ``progress`` returns a value from 0 to 1, where 1
means that the criterion is met.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from gensim2.tasks.measurement import Measurement

OPEN, CLOSED = 0.8, 0.2
"""Openness above which a joint counts as open in the paper, and openness below which it counts as closed."""
AJAR = (0.3, 0.7)
"""Openness range of a half-open joint."""
NEAR = 0.05
"""Horizontal distance (m) within which the paper considers two points to be together."""

THICKNESS, GAP = 0.001, 0.01
"""Minimum height (m) of an object's lowest point above the lowest point of its support, and maximum height above the
highest point.
"""

SCALE = 0.3
"""Distance (m) at which the progress towards a point is 0.24 (:func:`nearness`)."""

ROLES = ("object", "articulated", "rigid", "support")
"""Fields of criteria that name objects."""

Threshold = Annotated[float, Field(gt=0, lt=1)]


class _Criterion(BaseModel, ABC):
    model_config = ConfigDict(frozen=True, extra="forbid")

    @property
    def objects(self) -> tuple[str, ...]:
        """Names of the objects that the criterion concerns."""
        return tuple(getattr(self, role) for role in ROLES if role in type(self).model_fields)

    @abstractmethod
    def holds(self, measured: Measurement) -> bool:
        """Return whether the criterion holds; false if a measured value is NaN."""

    def holds_in_paper(self, measured: Measurement) -> bool:
        """Return whether the criterion holds by the definition of the original GenSim2."""
        return self.holds(measured)

    @abstractmethod
    def progress(self, measured: Measurement) -> float:
        """Return progress towards the criterion from 0 to 1; 1 if the criterion holds."""


class ArticulatedOpen(_Criterion):
    """The object's openness is above ``threshold``."""

    type: Literal["articulated_open"] = "articulated_open"
    object: str
    threshold: Threshold = OPEN

    def holds(self, measured: Measurement) -> bool:
        return measured.openness[self.object] > self.threshold

    def progress(self, measured: Measurement) -> float:
        return _share(measured.openness[self.object] / self.threshold)


class ArticulatedClosed(_Criterion):
    """The object's openness is below ``threshold``."""

    type: Literal["articulated_closed"] = "articulated_closed"
    object: str
    threshold: Threshold = CLOSED

    def holds(self, measured: Measurement) -> bool:
        return measured.openness[self.object] < self.threshold

    def progress(self, measured: Measurement) -> float:
        return _share((1.0 - measured.openness[self.object]) / (1.0 - self.threshold))


class ArticulatedBetween(_Criterion):
    """The object's openness is between ``low`` and ``high``."""

    type: Literal["articulated_between"] = "articulated_between"
    object: str
    low: Threshold = AJAR[0]
    high: Threshold = AJAR[1]

    @model_validator(mode="after")
    def _is_a_range(self) -> Self:
        if not self.low < self.high:
            raise ValueError("low must be less than high")
        return self

    def holds(self, measured: Measurement) -> bool:
        return self.low < measured.openness[self.object] < self.high

    def progress(self, measured: Measurement) -> float:
        openness = measured.openness[self.object]
        return _share(min(openness / self.low, (1.0 - openness) / (1.0 - self.high)))


class RigidLifted(_Criterion):
    """The rigid object is more than ``height`` (m) above its position at the reset."""

    type: Literal["rigidbody_lifted"] = "rigidbody_lifted"
    rigid: str
    height: Threshold = NEAR

    def holds(self, measured: Measurement) -> bool:
        return float(measured.poses[self.rigid][2] - measured.start_positions[self.rigid][2]) > self.height

    def progress(self, measured: Measurement) -> float:
        return _share(float(measured.poses[self.rigid][2] - measured.start_positions[self.rigid][2]) / self.height)


class RigidMoved(_Criterion):
    """Since the reset, the rigid object has moved more than ``distance`` (m) in ``direction``, as seen from the robot.
    Its sideways displacement is less than half of its displacement in this direction.
    """

    type: Literal["rigidbody_moved"] = "rigidbody_moved"
    rigid: str
    direction: Literal["away", "closer", "left", "right"]
    distance: Threshold = NEAR

    def holds(self, measured: Measurement) -> bool:
        along, across = self._way(measured)
        return bool(along > self.distance and abs(across) < along / 2)

    def _way(self, measured: Measurement) -> tuple[float, float]:
        """Return the horizontal displacements (m) since the reset, along the direction and across it."""
        x, y = map(float, measured.poses[self.rigid][:2] - measured.start_positions[self.rigid][:2])
        return {"away": (x, y), "closer": (-x, y), "left": (y, x), "right": (-y, x)}[self.direction]

    def progress(self, measured: Measurement) -> float:
        along, across = self._way(measured)
        return _share((along - max(0.0, abs(across) - along / 2)) / self.distance)


class RigidOnRigid(_Criterion):
    """A rigid object is on or in another object, its support.

    The origins of the object and the support are within ``threshold`` (m) horizontally, and the object's origin is at
    most ``height`` (m) above the support's origin. The object's lowest point is above the lowest point of the support,
    and at most 1 cm above the highest point of the support.
    """

    type: Literal["rigidbody_on_rigidbody"] = "rigidbody_on_rigidbody"
    rigid: str
    support: str
    threshold: Threshold = NEAR
    height: Threshold = 2 * NEAR

    def holds(self, measured: Measurement) -> bool:
        return self._excess(measured) < 0.0

    def progress(self, measured: Measurement) -> float:
        return nearness(self._excess(measured))

    def _excess(self, measured: Measurement) -> float:
        """Return the largest distance (m) by which a limit is exceeded; negative if all limits are kept."""
        x, y, z = map(float, (measured.poses[self.rigid] - measured.poses[self.support])[:3])
        found = [math.hypot(x, y) - self.threshold, z - self.height]
        if self.rigid in measured.bounds and self.support in measured.bounds:
            lowest, (below, above) = measured.bounds[self.rigid][0, 2], measured.bounds[self.support][:, 2]
            found += [float(below + THICKNESS - lowest), float(lowest - above - GAP)]
        return math.nan if any(map(math.isnan, found)) else max(found)


class _Distance(_Criterion):
    def holds(self, measured: Measurement) -> bool:
        return self._excess(measured) < 0.0 and self._height_excess(measured) <= 0.0

    def holds_in_paper(self, measured: Measurement) -> bool:
        return self._excess(measured) < 0.0

    def progress(self, measured: Measurement) -> float:
        return nearness(math.hypot(max(0.0, self._excess(measured)), self._height_excess(measured)))

    @abstractmethod
    def _excess(self, measured: Measurement) -> float:
        """Return the measured horizontal distance (m) minus the threshold.

        The result is negative below the threshold.
        """

    @abstractmethod
    def _height_excess(self, measured: Measurement) -> float:
        """Return the distance (m) that is missing to meet the condition on the height.

        The result is 0 if the condition is met or if shapes are unknown.
        """


class DistanceArticulatedRigid(_Distance):
    """A rigid object is near or inside an articulated object.

    The measured keypoint of an object is its last keypoint. The horizontal distance between the measured keypoints of
    the two objects is less than ``threshold`` (m). In addition, there is a condition on the height. If the articulated
    object is a container, the middle of the rigid object must be inside the container. If it is not a container, the
    rigid object's lowest point must not be above the articulated object's measured keypoint.
    """

    type: Literal["distance_articulated_rigidbody"] = "distance_articulated_rigidbody"
    articulated: str
    rigid: str
    threshold: Threshold = NEAR

    def _excess(self, measured: Measurement) -> float:
        return math.hypot(*(measured.point(self.articulated)[:2] - measured.point(self.rigid)[:2])) - self.threshold

    def _height_excess(self, measured: Measurement) -> float:
        if self._excess(measured) >= 0.0 or self.rigid in measured.contents.get(self.articulated, ()):
            return 0.0
        least = GAP if self.articulated in measured.contents else 0.0
        if self.rigid not in measured.bounds:
            return least
        return max(least, float(measured.bounds[self.rigid][0, 2] - measured.point(self.articulated)[2]))


class DistanceGripperRigid(_Distance):
    """The horizontal distance between a keypoint of the gripper and the rigid object's measured keypoint is less than
    ``threshold`` (m), and the keypoint of the gripper is at most ``threshold`` above or below the object.
    """

    type: Literal["distance_gripper_rigidbody"] = "distance_gripper_rigidbody"
    rigid: str
    threshold: Threshold = NEAR

    def _excess(self, measured: Measurement) -> float:
        return _from_gripper(measured, self.rigid) - self.threshold

    def _height_excess(self, measured: Measurement) -> float:
        return _beyond_height(measured, self.rigid, self.threshold)


class DistanceGripperArticulated(_Distance):
    """The gripper is near an articulated object.

    At least one keypoint of the gripper has a horizontal distance of less than ``threshold`` (m) from the articulated
    object's measured keypoint (its last keypoint). This keypoint of the gripper is also at most ``threshold`` above or
    below the link that has the measured keypoint.
    """

    type: Literal["distance_gripper_articulated"] = "distance_gripper_articulated"
    articulated: str
    threshold: Threshold = NEAR

    def _excess(self, measured: Measurement) -> float:
        return _from_gripper(measured, self.articulated) - self.threshold

    def _height_excess(self, measured: Measurement) -> float:
        return _beyond_height(measured, self.articulated, self.threshold)


JointCriterion = ArticulatedOpen | ArticulatedClosed | ArticulatedBetween
JOINT = (ArticulatedOpen, ArticulatedClosed, ArticulatedBetween)
"""Criteria on the position of a joint."""

OF_GRIPPER = (DistanceGripperRigid, DistanceGripperArticulated)
"""Criteria on the position of the gripper."""

Criterion = Annotated[
    ArticulatedOpen
    | ArticulatedClosed
    | ArticulatedBetween
    | RigidLifted
    | RigidMoved
    | RigidOnRigid
    | DistanceArticulatedRigid
    | DistanceGripperRigid
    | DistanceGripperArticulated,
    Field(discriminator="type"),
]


def all_hold(criteria: tuple[Criterion, ...], measured: Measurement) -> bool:
    """Return whether all criteria hold; true if there are no criteria."""
    return all(criterion.holds(measured) for criterion in criteria)


def all_hold_in_paper(criteria: tuple[Criterion, ...], measured: Measurement) -> bool:
    """Return whether all criteria hold by the definitions of the original GenSim2."""
    return all(criterion.holds_in_paper(measured) for criterion in criteria)


def nearness(distance: float) -> float:
    """Convert the distance (m) by which a limit is exceeded to a reward from 0 to 1.

    The reward is 1 if the limit is not exceeded (the distance is zero or negative), 0.24 if the distance equals
    ``SCALE``, and nearly 0 if the distance is 1 m.
    """
    return _share(1.0 - math.tanh(max(distance, 0.0) / SCALE))


def _share(value: float) -> float:
    """Clip a number to 0..1; NaN becomes 0."""
    return 0.0 if math.isnan(value) else float(min(1.0, max(0.0, value)))


def _beyond_height(measured: Measurement, name: str, threshold: float) -> float:
    """Return the height (m) by which the gripper is too far above or below an object.

    A keypoint of the gripper counts only if its horizontal distance from the object's measured keypoint is less than
    ``threshold`` (m). The limits of its height are ``threshold`` above and below the object. If one keypoint is within
    the limits, the result is 0. Otherwise the result is how far the best keypoint exceeds them. The result is also 0 if
    no keypoint counts, or if the object's shape is unknown.
    """
    if name not in measured.bounds:
        return 0.0
    low, high = measured.bounds[name][:, 2]
    point = measured.point(name)[:2]
    near = [at[2] for at in measured.gripper.values() if float(np.hypot(*(at[:2] - point))) < threshold]
    beyond = min((max(float(low - z), float(z - high)) for z in near), default=threshold)
    return max(0.0, beyond - threshold)


def _from_gripper(measured: Measurement, name: str) -> float:
    point = measured.point(name)[:2]
    return min(float(np.hypot(*(place[:2] - point))) for place in measured.gripper.values())

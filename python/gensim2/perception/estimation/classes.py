"""Define constants of the object classes that an estimator knows, such as the names of keypoints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator

from gensim2.core.arrays import Array
from gensim2.core.errors import InputError
from gensim2.core.plural import plural
from gensim2.objects.types import ArticulatedObject

SLOTS = 3
"""Maximum number of keypoints of a class."""

HALF_TURN = 2.5
"""Minimum joint range (rad) of a bail."""

DIRECTIONS: Array = np.concatenate([np.eye(3), -np.eye(3)])
"""Possible joint axes (6, 3) of an object in its default placement: the world's axes in both directions."""

Number = Annotated[float, Field(allow_inf_nan=False, ge=-100.0, le=100.0)]
Row = tuple[Number, Number, Number]
Positive = Annotated[float, Field(gt=0.0, le=100.0)]


class ClassConstants(BaseModel):
    """Constants of a class of articulated objects.

    Attributes:
        name: name of the class.
        joint_type: type of the joint of the class's objects.
        keypoints: names of the keypoints, in the order in which the objects list them.
        moving: for each keypoint, whether the joint moves the keypoint.
        object_axis: axis of the object frame about which the hand turns in the planner's "rotate" motions.
        frame: (3, 3) rotation of the object frame in the world, if the object is in its default placement and its joint
            is at zero.
        span: smallest and largest joint range (rad or m) of the training objects; None if it is not known.
        least_extent: extent (m) that the visible part of the training objects has at least, before the deformation of
            the training clouds (:func:`~gensim2.perception.estimation.presence.connected_extent`); None if it is not
            known.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$", max_length=100)]
    joint_type: Literal["revolute", "prismatic"]
    keypoints: Annotated[tuple[str, ...], Field(min_length=1, max_length=SLOTS)]
    moving: tuple[bool, ...]
    object_axis: Literal["x", "y", "z"]
    frame: tuple[Row, Row, Row]
    span: tuple[Positive, Positive] | None = None
    least_extent: Positive | None = None

    @field_validator("moving")
    @classmethod
    def _fits(cls, moving: tuple[bool, ...], info: ValidationInfo) -> tuple[bool, ...]:
        keypoints = info.data.get("keypoints", ())  # invalid keypoints are missing here, and have an error of their own
        if keypoints and len(moving) != len(keypoints):
            raise ValueError(f"needs {plural(len(keypoints), 'value')}, one for each keypoint, not {len(moving)}")
        return moving

    @property
    def is_bail(self) -> bool:
        """Whether the joint swings a bail, the arched handle of a bucket, from one side of the object to the other."""
        swings = self.joint_type == "revolute" and self.span is not None and self.span[0] >= HALF_TURN
        # The y axis of an object is vertical.
        return swings and self.object_axis != "y" and self.moving == (True,)

    @staticmethod
    def of(model: ArticulatedObject) -> ClassConstants:
        """Return the constants of the class of an object.

        Raises:
            InputError: the object has more keypoints than an estimator predicts.
        """
        if len(model.keypoints) > SLOTS:
            message = f"{model.asset_class} has {len(model.keypoints)} keypoints; an estimator predicts at most {SLOTS}"
            raise InputError(message, field="classes", remedy="train the estimator without this class")
        turn = model.placement.rotation @ model.joint.T_root_child[:3, :3] @ model.T_link_object[:3, :3]
        return ClassConstants(
            name=model.asset_class,
            joint_type=model.joint.type,
            keypoints=tuple(model.keypoints),
            moving=tuple(point.link == model.joint.child_link for point in model.keypoints.values()),
            object_axis=model.object_axis,
            frame=turn.tolist(),
        )

    def over(self, ranges: Array, extent: float) -> ClassConstants:
        """Return constants that also cover further training objects.

        Args:
            ranges: (N,) joint ranges of the objects, rad or m.
            extent: smallest visible extent of the objects, m; 0 if the cameras hardly see them.
        """
        spans = [*(self.span or ()), float(ranges.min()), float(ranges.max())]
        # A class whose objects the cameras hardly see has no smallest extent.
        least = min(extent, self.least_extent or extent)
        return self.model_copy(update={"span": (min(spans), max(spans)), "least_extent": least or None})


def direction_of(model: ArticulatedObject) -> int:
    """Return the index of the direction in ``DIRECTIONS`` that is closest to the joint axis of an object in its default
    placement.
    """
    return int(np.argmax(DIRECTIONS @ (model.placement.rotation @ model.joint.axis)))


def by_name(classes: Sequence[ClassConstants], name: str) -> int:
    """Return the index of the class with the given name.

    Raises:
        InputError: the estimator does not know the class.
    """
    names = [each.name for each in classes]
    if name not in names:
        raise InputError(
            f"the estimator does not know the class {name!r}", field="class", remedy=f"choose from {', '.join(names)}"
        )
    return names.index(name)

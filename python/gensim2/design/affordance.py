"""Affordances of a class of objects, for designers: no simulator, no geometry beyond what it needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Literal

import numpy as np

from gensim2.design.pictures import LazyPicture
from gensim2.objects import RigidObject
from gensim2.objects.types import ArticulatedObject, Kind
from gensim2.objects.words import noun

JointType = Literal["revolute", "prismatic"]

INSIDE = "inside"
"""In the name of the measured point of what contains."""


@dataclass(frozen=True)
class Affordance:
    """A class of objects; where its objects differ, the mean of those that were looked at.

    Attributes:
        asset_class: class name.
        kind: ``"articulated"`` or ``"rigid"``.
        noun: what a person calls one.
        description: one phrase.
        size: (3,) extents in metres as it stands: away from the robot, to its side, up; an articulated one with its
            joint at zero.
        mass: kg.
        keypoints: name to description, those that every seen object has; the last one is the measured point, by which
            distances go.
        lever_arms: of those on the moving link, name to distance in metres from the joint's axis (revolute) or zero
            (prismatic); empty of a rigid object.
        joint_type: of the joint; None of a rigid object.
        joint_range: lower and upper limit, rad or m; openness goes from 0 to 1 between them.
        joint_axis: ``"vertical"`` or ``"level"`` as it stands: a hinge's axis, or the way of what slides.
        default_openness: mean openness at the start of an episode.
        grip_width: metres between the fingertips that hold a rigid object at its narrowest, as it rests.
        picture: of one, its keypoints named; None: there is none.
    """

    asset_class: str
    kind: Kind
    noun: str
    description: str
    size: tuple[float, float, float]
    mass: float
    keypoints: dict[str, str]
    lever_arms: dict[str, float]
    joint_type: JointType | None = None
    joint_range: tuple[float, float] | None = None
    joint_axis: Literal["vertical", "level"] | None = None
    default_openness: float | None = None
    grip_width: float | None = None
    picture: LazyPicture | None = field(default=None, compare=False)

    @property
    def measured(self) -> str:
        """Name of the keypoint by which distances go."""
        return list(self.keypoints)[-1]

    @property
    def is_container(self) -> bool:
        """Whether it has room inside, by the name of its measured point."""
        return bool(self.keypoints) and self.joint_type is not None and INSIDE in self.measured

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data, without what there is not, and without the picture."""
        values = {each.name: getattr(self, each.name) for each in fields(self) if each.name != "picture"}
        return {name: value for name, value in values.items() if value not in (None, {})}

    @staticmethod
    def of(
        objects: Sequence[ArticulatedObject | RigidObject],
        description: str = "",
        picture: LazyPicture | None = None,
    ) -> Affordance:
        """Return what ``objects`` of one class have in common."""
        first = objects[0]
        shared = {
            name: point.description
            for name, point in first.keypoints.items()
            if all(name in other.keypoints for other in objects)
        }
        size = np.mean([_extents(each) for each in objects], axis=0)
        common: dict[str, Any] = {
            "asset_class": first.asset_class,
            "noun": noun(first.asset_class),
            "description": description,
            "size": tuple(round(float(value), 4) for value in size),
            "mass": float(np.mean([each.mass for each in objects])),
            "keypoints": shared,
            "picture": picture,
        }
        if isinstance(first, RigidObject):
            return Affordance(kind="rigid", lever_arms={}, grip_width=first.grip.width, **common)
        instances = [each for each in objects if isinstance(each, ArticulatedObject)]
        joint = instances[0].joint
        moving = [
            name for name in shared if all(each.keypoints[name].link == each.joint.child_link for each in instances)
        ]
        return Affordance(
            kind="articulated",
            lever_arms={name: float(np.mean([_lever_arm(each, name) for each in instances])) for name in moving},
            joint_type=joint.type,
            joint_range=(
                float(np.mean([each.joint.lower for each in instances])),
                float(np.mean([each.joint.upper for each in instances])),
            ),
            joint_axis="vertical" if abs(float((first.placement.rotation @ joint.axis)[2])) > 0.7 else "level",
            default_openness=instances[0].default_openness,
            **common,
        )


def _lever_arm(instance: ArticulatedObject, keypoint: str) -> float:
    return instance.lever_arm(keypoint) if instance.joint.type == "revolute" else 0.0


def _extents(model: ArticulatedObject | RigidObject) -> np.ndarray[Any, Any]:
    """(3,) as it stands before its randomization, m."""
    corners = []
    for link, hulls in model.hulls.items():
        turn = np.eye(4)
        if isinstance(model, ArticulatedObject) and link == model.joint.child_link:
            turn = model.joint.T_root_child
        corners += [hull @ turn[:3, :3].T + turn[:3, 3] for hull in hulls]
    return np.asarray(np.ptp(np.concatenate(corners) @ model.placement.rotation.T, axis=0))

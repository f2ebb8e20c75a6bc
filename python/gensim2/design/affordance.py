"""Summarize a class of objects for designers: sizes, keypoints and joint, without the simulator."""

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
"""Substring of the name of a container's measured keypoint."""


@dataclass(frozen=True)
class Affordance:
    """Summary of a class of objects; sizes and distances are means over a few instances.

    Attributes:
        asset_class: class name.
        kind: ``"articulated"`` or ``"rigid"``.
        noun: everyday name of an object of the class.
        description: phrase that describes the class.
        size: (3,) extents in metres in the resting pose with the joint at zero: depth (away from the robot), width,
            height.
        mass: mean mass, kg.
        keypoints: description of each keypoint that all sampled instances have, by name. The last is the measured
            keypoint, which distance criteria use.
        lever_arms: distance in metres from the joint axis of each keypoint on the moving link, by name; zero for a
            prismatic joint, empty for a rigid object.
        joint_type: ``"revolute"`` or ``"prismatic"``; None for a rigid object.
        joint_range: lower and upper joint limit, rad or m, at openness 0 and 1.
        joint_axis: ``"vertical"`` or ``"level"``: direction of the hinge axis, or of the motion of a prismatic joint.
        default_openness: mean openness at the start of an episode.
        grip_width: distance in metres between the fingertips that hold a rigid object across its narrowest side.
        picture: picture of one instance with labelled keypoints, or None.
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
        """Name of the keypoint that distance criteria use."""
        return list(self.keypoints)[-1]

    @property
    def is_container(self) -> bool:
        """Whether objects of the class are containers, judged by the name of the measured keypoint."""
        return bool(self.keypoints) and self.joint_type is not None and INSIDE in self.measured

    def to_dict(self) -> dict[str, Any]:
        """Return a dictionary for JSON, without the picture and empty fields."""
        values = {each.name: getattr(self, each.name) for each in fields(self) if each.name != "picture"}
        return {name: value for name, value in values.items() if value not in (None, {})}

    @staticmethod
    def of(
        objects: Sequence[ArticulatedObject | RigidObject],
        description: str = "",
        picture: LazyPicture | None = None,
    ) -> Affordance:
        """Summarize ``objects``, which all have the same class."""
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
    """Return the extents (3,) of an object in metres, in its resting pose."""
    corners = []
    for link, hulls in model.hulls.items():
        turn = np.eye(4)
        if isinstance(model, ArticulatedObject) and link == model.joint.child_link:
            turn = model.joint.T_root_child
        corners += [hull @ turn[:3, :3].T + turn[:3, 3] for hull in hulls]
    return np.asarray(np.ptp(np.concatenate(corners) @ model.placement.rotation.T, axis=0))

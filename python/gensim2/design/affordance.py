"""Summarize a class of objects for designers: sizes, keypoints and joint, without the simulator."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, Literal

import numpy as np

from gensim2.core.arrays import Array
from gensim2.design.pictures import LazyPicture
from gensim2.objects import RigidObject
from gensim2.objects.types import ArticulatedObject, Kind
from gensim2.objects.words import noun

Triple = tuple[float, float, float]

JointType = Literal["revolute", "prismatic"]

INSIDE = "inside"
"""Substring of the name of a container's measured keypoint."""

PLACES = (INSIDE, "above", "bottom", "surface")
"""Substrings of the name of a measured keypoint at which an object can be put."""


MOVES = 0.005
"""A keypoint has an opening direction if it moves by this distance (m) or more in a fifth of the joint range."""


@dataclass(frozen=True)
class KeypointFacts:
    """Geometry at a keypoint. All values are means over the instances of a class in their poses before randomization.

    Attributes:
        position: (3,) position in the world, m.
        opening: (3,) unit direction in the world in which the keypoint moves as the joint opens. None if it does not
            move.
        part: (3,) size of the convex part that is nearest to the keypoint, along the axes of the world, m.
    """

    position: Triple
    opening: Triple | None
    part: Triple


@dataclass(frozen=True)
class Affordance:
    """Summary of a class of objects; sizes and distances are means over a few instances.

    Attributes:
        asset_class: class name.
        kind: ``"articulated"`` or ``"rigid"``.
        noun: everyday name of an object of the class.
        description: phrase that describes the class.
        size: (3,) depth (away from the robot), width and height at rest, with the joint at zero, m.
        mass: mass, kg.
        keypoints: descriptions by name of the keypoints that all instances have. The last keypoint is the measured one.
        lever_arms: distances (m) of moving keypoints from the axis. The distances are zero for a prismatic joint; a
            rigid object has none.
        joint_type: ``"revolute"`` or ``"prismatic"``; None for a rigid object. If the types of the instances differ, it
            is the more frequent type, and all joint values are means over the instances of this type.
        joint_range: lower joint limit (openness 0) and upper joint limit (openness 1), rad or m.
        joint_axis: ``"vertical"`` or ``"level"``, the direction of the axis of a hinge or of a prismatic motion.
        default_openness: mean openness at the start of an episode.
        grip_width: distance in metres between the fingertips when they hold a rigid object across its narrowest side.
        measured_at: (3,) measured keypoint of a rigid object relative to its middle, in the resting pose, m.
        picture: picture of one instance with labelled keypoints, or None.
        samples: the articulated instances that the values summarize.
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
    measured_at: Triple = (0.0, 0.0, 0.0)
    picture: LazyPicture | None = field(default=None, compare=False)
    samples: tuple[ArticulatedObject, ...] = field(default=(), compare=False, repr=False)

    @property
    def hinge_axes(self) -> list[Array] | None:
        """Unit vector (3,) along each instance's hinge axis, in the world frame; None for a class without a hinge."""
        if self.joint_type != "revolute" or not self.samples:
            return None
        return [each.placement.rotation @ each.joint.axis for each in self.samples]

    @property
    def measured(self) -> str:
        """Name of the keypoint that distance criteria use."""
        return list(self.keypoints)[-1]

    @property
    def place(self) -> str | None:
        """Name of the keypoint that marks where another object can be put; None for a class without such a keypoint."""
        named = self.joint_type is not None and self.keypoints and any(word in self.measured for word in PLACES)
        return self.measured if named else None

    def facts(self, openness: float, at: tuple[float, float] | None = None) -> dict[str, KeypointFacts]:
        """Return the geometry at each keypoint by name; empty for a rigid object.

        Args:
            openness: openness of the joint.
            at: x and y of the object in the world, m; None: its default placement.
        """
        return {
            name: _facts(self.samples, name, name in self.lever_arms, openness, at)
            for name in self.keypoints
            if self.samples
        }

    @cached_property
    def interior(self) -> Triple | None:
        """Extents (3,) of the free space inside a container: depth, width and height, m, or None for other classes."""
        return _interior(self.samples, self.measured) if self.samples and self.is_container else None

    @property
    def is_container(self) -> bool:
        """Whether objects of the class are containers, judged by the name of the measured keypoint."""
        return self.place is not None and INSIDE in self.place

    def to_dict(self) -> dict[str, Any]:
        """Return plain data without the picture, the samples and empty fields."""
        left_out = ("measured_at", "picture", "samples")
        values = {each.name: getattr(self, each.name) for each in fields(self) if each.name not in left_out}
        return {name: value for name, value in values.items() if value not in (None, {})}

    @staticmethod
    def of(
        objects: Sequence[ArticulatedObject | RigidObject], description: str = "", picture: LazyPicture | None = None
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
            at = _triple(np.mean([_measured_at(each) for each in objects], axis=0))
            return Affordance(kind="rigid", lever_arms={}, grip_width=first.grip.width, measured_at=at, **common)
        articulated = [each for each in objects if isinstance(each, ArticulatedObject)]
        # Average over the instances of the more frequent joint type only, because the units of the types differ (rad
        # and m).
        ((kind, _),) = Counter(each.joint.type for each in articulated).most_common(1)
        instances = [each for each in articulated if each.joint.type == kind]
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
            joint_axis=("vertical" if abs(float((instances[0].placement.rotation @ joint.axis)[2])) > 0.7 else "level"),
            default_openness=instances[0].default_openness,
            samples=tuple(instances),
            **common,
        )


def _lever_arm(instance: ArticulatedObject, keypoint: str) -> float:
    return instance.lever_arm(keypoint) if instance.joint.type == "revolute" else 0.0


def _poses(instance: ArticulatedObject, openness: float, at: tuple[float, float] | None = None) -> dict[str, Array]:
    """Return the pose (4, 4) of each link in the world, at the place ``at`` or in the default placement."""
    T_world_root = np.eye(4)
    T_world_root[:3, :3], T_world_root[:3, 3] = instance.placement.rotation, instance.placement.position
    if at is not None:
        T_world_root[:2, 3] = at
    child = instance.joint.child_link
    return {
        link: T_world_root @ (instance.link_pose(openness) if link == child else np.eye(4)) for link in instance.hulls
    }


def _facts(
    instances: Sequence[ArticulatedObject], name: str, moves: bool, openness: float, at: tuple[float, float] | None
) -> KeypointFacts:
    """Return the mean geometry of ``instances`` at the keypoint ``name``.

    Args:
        name: name of the keypoint.
        moves: whether the joint moves the keypoint.
        openness: openness of the joint.
        at: x and y of the objects in the world, m; None: their default placement.
    """
    found = []
    for each in instances:
        point = each.keypoints[name]
        before, after = max(0.0, openness - 0.1), min(1.0, openness + 0.1)
        here, low, high = (
            (T[:3, :3] @ point.position + T[:3, 3])
            for T in (_poses(each, value, at)[point.link] for value in (openness, before, after))
        )
        T = _poses(each, openness, at)[point.link]
        hulls = [hull @ T[:3, :3].T + T[:3, 3] for hull in each.hulls[point.link]]
        apart = [float(np.linalg.norm(np.maximum(0.0, np.maximum(h.min(0) - here, here - h.max(0))))) for h in hulls]
        part = np.ptp(hulls[int(np.argmin(apart))], axis=0) if hulls else np.zeros(3)
        found.append((here, high - low, part))
    position, way, part = (np.mean(values, axis=0) for values in zip(*found, strict=True))
    opening = _triple(way / np.linalg.norm(way)) if moves and np.linalg.norm(way) > MOVES else None
    return KeypointFacts(_triple(position), opening, _triple(part))


def _interior(instances: Sequence[ArticulatedObject], name: str) -> Triple | None:
    """Return the mean extents of the free space around a keypoint, or None if an instance has no such space."""
    from gensim2.objects.meshwork.interior import inner_box

    sizes = []
    for each in instances:
        point = each.keypoints[name]
        turn = _poses(each, each.default_openness)[point.link][:3, :3]
        box = inner_box(each.hulls[point.link], point.position, turn[2])
        if box is None:
            return None
        sizes.append(np.abs(turn @ (box.high - box.low)))
    return _triple(np.mean(sizes, axis=0))


def _triple(values: Array) -> Triple:
    x, y, z = (round(float(value), 3) + 0.0 for value in values)
    return x, y, z


def _measured_at(model: ArticulatedObject | RigidObject) -> Array:
    """Return the field ``measured_at`` of one rigid object."""
    turn = model.placement.rotation
    corners = np.concatenate([hull for hulls in model.hulls.values() for hull in hulls]) @ turn.T
    point = list(model.keypoints.values())[-1].position
    return np.asarray(turn @ point - (corners.min(axis=0) + corners.max(axis=0)) / 2)


def _extents(model: ArticulatedObject | RigidObject) -> np.ndarray[Any, Any]:
    """Return the extents (3,) of an object in metres, in its resting pose."""
    corners = []
    for link, hulls in model.hulls.items():
        turn = np.eye(4)
        if isinstance(model, ArticulatedObject) and link == model.joint.child_link:
            turn = model.joint.T_root_child
        corners += [hull @ turn[:3, :3].T + turn[:3, 3] for hull in hulls]
    return np.asarray(np.ptp(np.concatenate(corners) @ model.placement.rotation.T, axis=0))

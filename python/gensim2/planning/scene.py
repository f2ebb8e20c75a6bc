"""The value that the simulator, or a robot's perception, hands to the planner: geometry only, no simulator types."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

CENTER = "rigidbody_object_center"
"""Name in configs of a rigid object's centre of mass: the way from it to a keypoint says how the object is turned."""
MEASURED = "rigidbody_object_measured"
"""Name in configs of the keypoint of a rigid object that criteria go by, its last: which one depends on the object."""


@dataclass(frozen=True)
class SceneBody:
    """A rigid piece of the scene: the table, a link of an object, or a rigid object.

    Attributes:
        name: unique in the scene: ``"table"``, ``"<object>/<link>"``, or the name of a rigid object.
        hulls: convex vertex sets, each (N, 3) metres in the body frame. The same tuple in every scene of an episode,
            so that what is made of it can be kept.
        T_base_body: (4, 4) pose in the robot base frame.
    """

    name: str
    hulls: tuple[Array, ...]
    T_base_body: Array


@dataclass(frozen=True)
class JointState:
    """An object's joint as it stands in the scene.

    Attributes:
        type: ``"revolute"`` or ``"prismatic"``.
        origin, axis: (3,) in the robot base frame.
        value, lower, upper: rad or m.
        moves: names of the bodies that it moves.
    """

    type: Literal["revolute", "prismatic"]
    origin: Array
    axis: Array
    value: float
    lower: float
    upper: float
    moves: tuple[str, ...]

    @property
    def openness(self) -> float:
        """(value - lower) / (upper - lower)."""
        return (self.value - self.lower) / (self.upper - self.lower)


@dataclass(frozen=True)
class SceneObject:
    """One object of the scene.

    Attributes:
        name: its role in the task.
        bodies: of which it is made.
        T_base_object: (4, 4) object frame in the robot base frame.
        keypoints: name to (3,) metres in the robot base frame, in the object's own order.
        joint: of an articulated object; None of a rigid one.
        object_axis: axis of the object frame that "rotate" motions turn about.
        yaw: rad that the randomization turned it by.
        center_of_mass: (3,) of a rigid object in its frame, m.
        mass: of a rigid object, kg; None where it is unknown.
        friction: coefficient of a rigid object's surface; None where it is unknown.
    """

    name: str
    bodies: tuple[SceneBody, ...]
    T_base_object: Array
    keypoints: Mapping[str, Array]
    joint: JointState | None = None
    object_axis: Literal["x", "y", "z"] = "y"
    yaw: float = 0.0
    center_of_mass: Array | None = None
    mass: float | None = None
    friction: float | None = None

    @property
    def is_rigid(self) -> bool:
        """Whether it has no joint: what a hand may pick up."""
        return self.joint is None

    @property
    def points(self) -> dict[str, Array]:
        """Points that configs may name, as ``keypoints``: these, and of a rigid object ``CENTER`` and ``MEASURED``."""
        if self.center_of_mass is None:
            return dict(self.keypoints)
        center = self.T_base_object[:3, :3] @ self.center_of_mass + self.T_base_object[:3, 3]
        return {CENTER: center, MEASURED: list(self.keypoints.values())[-1], **self.keypoints}


@dataclass(frozen=True)
class Scene:
    """Everything that planning needs to know, at one instant.

    Attributes:
        q, qvel: (n,) robot joints and their velocities, rad and m, in the robot's active joint order.
        T_world_base: (4, 4) robot base in the world.
        objects: by name, in the task's order.
        fixtures: what stands there and is no object: the table.
        held: name of the rigid object in the hand, or None.
        held_width: distance of the pads (m) at which it was grasped; None where it is unknown.
        held_force: with which each finger presses on it, N.
        finger_friction: coefficient of the fingers' surface; None where it is unknown.
        finger_stiffness: of the fingers' drives, N/m; None: that of the robot's profile.
    """

    q: Array
    qvel: Array
    T_world_base: Array
    objects: Mapping[str, SceneObject]
    fixtures: tuple[SceneBody, ...] = field(default=())
    held: str | None = None
    held_width: float | None = None
    held_force: float | None = None
    finger_friction: float | None = None
    finger_stiffness: float | None = None

    def grip_friction(self, name: str) -> float | None:
        """Coefficient between the fingers and a rigid object: the mean of both surfaces; None where it is unknown."""
        surface = self.objects[name].friction
        return None if surface is None or self.finger_friction is None else 0.5 * (surface + self.finger_friction)

    @property
    def bodies(self) -> tuple[SceneBody, ...]:
        """Fixtures, then the bodies of every object."""
        return (*self.fixtures, *(body for thing in self.objects.values() for body in thing.bodies))

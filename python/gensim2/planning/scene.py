"""Define the planner's description of a scene: geometry and joint states, from the simulator or from perception."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from gensim2.core.arrays import Array

CENTER = "rigidbody_object_center"
"""Name by which a solver config refers to a rigid object's centre of mass."""
MEASURED = "rigidbody_object_measured"
"""Name by which a solver config refers to a rigid object's last keypoint, the point that success criteria measure."""


@dataclass(frozen=True)
class SceneBody:
    """A rigid body of the scene: the table, a link of an object, or a rigid object.

    Attributes:
        name: unique in the scene: ``"table"``, ``"<object>/<link>"``, or the name of a rigid object.
        hulls: vertices (N, 3) of the hulls in the body frame, metres. The tuple stays the same object, so that planners
            can cache by it.
        T_base_body: (4, 4) pose in the robot base frame.
    """

    name: str
    hulls: tuple[Array, ...]
    T_base_body: Array


@dataclass(frozen=True)
class JointState:
    """State of an object's joint.

    Attributes:
        type: ``"revolute"`` or ``"prismatic"``.
        origin, axis: (3,) point on the joint axis (m) and unit direction of the axis, in the robot base frame.
        value, lower, upper: rad or m.
        moves: names of the bodies that the joint moves.
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
        """Fraction of the joint's range, (value - lower) / (upper - lower): 0 is closed, 1 is open."""
        return (self.value - self.lower) / (self.upper - self.lower)


@dataclass(frozen=True)
class SceneObject:
    """An object of the scene.

    Attributes:
        name: name in the task.
        bodies: bodies of the object.
        T_base_object: (4, 4) object frame in the robot base frame.
        keypoints: keypoint positions (3,) by name, m, in the robot base frame, in the object's own order.
        joint: joint of an articulated object; None for a rigid object.
        object_axis: axis of the object frame about which "rotate" motions turn.
        yaw: angle by which randomization has rotated the object about the vertical, rad.
        center_of_mass: (3,) centre of mass of a rigid object in its frame, m; None if unknown.
        mass: mass of a rigid object, kg; None if unknown.
        friction: friction coefficient of a rigid object's surface; None if unknown.
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
        """Whether the object has no joint, so that a hand may pick it up."""
        return self.joint is None

    @property
    def points(self) -> dict[str, Array]:
        """Return the points that a config may name: keypoints and, for rigid objects, ``CENTER`` and ``MEASURED``."""
        if self.center_of_mass is None:
            return dict(self.keypoints)
        center = self.T_base_object[:3, :3] @ self.center_of_mass + self.T_base_object[:3, 3]
        return {CENTER: center, MEASURED: list(self.keypoints.values())[-1], **self.keypoints}


@dataclass(frozen=True)
class Scene:
    """State of robot and objects at one instant, as the planner needs it.

    Attributes:
        q, qvel: (n,) positions (rad or m) and velocities (rad/s or m/s) of the active joints, in the robot's order.
        T_world_base: (4, 4) pose of the robot base in the world.
        objects: objects by name, in the task's order.
        fixtures: bodies that belong to no object, such as the table.
        held: name of the grasped rigid object, or None.
        held_width: distance between the finger pads while they hold the object, m; None if unknown.
        held_force: force of each finger on the grasped object, N.
        finger_friction: friction coefficient of the fingers' surface; None if unknown.
        finger_stiffness: stiffness of the finger drives, N/m; None: that of the robot profile.
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
        """Return the mean friction coefficient of the fingers and a rigid object, or None if one of the two is
        unknown.
        """
        surface = self.objects[name].friction
        return None if surface is None or self.finger_friction is None else 0.5 * (surface + self.finger_friction)

    @property
    def bodies(self) -> tuple[SceneBody, ...]:
        """Return the fixtures, then the bodies of every object."""
        return (*self.fixtures, *(body for thing in self.objects.values() for body in thing.bodies))

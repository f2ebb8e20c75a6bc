"""The value that the simulator hands to the planner: geometry only, no simulator types."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Role = Literal["table", "object_body", "moving_link", "rigid"]


@dataclass(frozen=True)
class SceneBody:
    """A rigid obstacle.

    Attributes:
        name: unique in the scene.
        role: what the default contact rules go by.
        hulls: convex vertex sets, each (N, 3) metres in the body frame.
        T_base_body: (4, 4) pose in the robot base frame.
    """

    name: str
    role: Role
    hulls: tuple[Array, ...]
    T_base_body: Array


@dataclass(frozen=True)
class JointState:
    """The object's moving joint as it stands in the scene; ``origin`` and ``axis`` are (3,) in the robot base frame."""

    type: Literal["revolute", "prismatic"]
    origin: Array
    axis: Array
    value: float
    lower: float
    upper: float

    @property
    def openness(self) -> float:
        """(value - lower) / (upper - lower)."""
        return (self.value - self.lower) / (self.upper - self.lower)


@dataclass(frozen=True)
class Scene:
    """Everything that planning needs to know, at one instant.

    Attributes:
        q: (9,) robot joints, 7 arm and 2 fingers, rad and m.
        T_world_base: (4, 4) robot base in the world.
        T_base_object: (4, 4) object frame in the robot base frame.
        object_keypoints: name to (3,) metres in the robot base frame.
        joint: the object's joint.
        object_yaw: yaw in rad that the randomization drew.
        bodies: table, object links, rigid objects.
    """

    q: Array
    T_world_base: Array
    T_base_object: Array
    object_keypoints: dict[str, Array]
    joint: JointState
    object_yaw: float
    bodies: tuple[SceneBody, ...]

"""Read :class:`~gensim2.planning.scene.Scene` and :class:`Measurement` from the simulator as float64 values."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

import numpy as np

from gensim2.core.arrays import Array
from gensim2.core.errors import GenSim2Error
from gensim2.planning.scene import Scene, SceneBody
from gensim2.robots import RobotProfile
from gensim2.scenes.geometry import bounds_of, contents_of
from gensim2.scenes.initial_state import InitialState
from gensim2.scenes.table import HALF_SIZE, corners
from gensim2.sim.parts import ArticulatedPart, Frame, LazyMapping, Part, Parts, RigidPart
from gensim2.tasks.measurement import Measurement

_TABLE_HULLS = (corners(),)


class RobotReader(ABC):
    """Base class that reads a robot's state in a scene; each engine has a subclass."""

    def __init__(self, profile: RobotProfile) -> None:
        self.profile = profile

    @property
    @abstractmethod
    def q(self) -> Array:
        """Joints (n,), rad or m, in the profile's active joint order."""

    @property
    @abstractmethod
    def qvel(self) -> Array:
        """Joint velocities (n,)."""

    @abstractmethod
    def hand(self) -> Frame:
        """Return the current pose of the hand."""

    @property
    @abstractmethod
    def finger_friction(self) -> float:
        """Friction coefficient of the fingers."""

    @property
    @abstractmethod
    def finger_stiffness(self) -> float:
        """Stiffness of the finger drives, N/m or N m/rad."""

    def gripper(self) -> Mapping[str, Array]:
        """Return the tool keypoints (3,) in the world frame, m."""
        hand = self.hand()
        return LazyMapping(lambda: self.profile.gripper_at(hand.matrix()))

    @property
    def finger_opening(self) -> float:
        """Return the distance between the finger pads, m."""
        return self.profile.gripper.opening(self.q[self.profile.arm_size :])


class StandingRobot:
    """State of a robot in its start configuration with open fingers, for scenes without a robot.

    Args:
        start: (n,) all active joints at the start of the episode.
    """

    def __init__(self, profile: RobotProfile, start: Sequence[float]) -> None:
        self._profile, self._start = profile, start

    def gripper(self) -> Mapping[str, Array]:
        return self._profile.gripper_with(self._start)

    @property
    def finger_opening(self) -> float:
        return self._profile.gripper.widest


def measure(robot: RobotReader | StandingRobot, parts: Parts) -> Measurement:
    """Measure the current state in the world frame, for success criteria."""
    articulated = {name: part for name, part in parts.items() if isinstance(part, ArticulatedPart)}
    rigid = {name: part for name, part in parts.items() if isinstance(part, RigidPart)}
    models = {name: part.model for name, part in parts.items()}
    frames = {name: part.measured_frame() for name, part in parts.items()}

    def poses() -> dict[str, Array]:
        return {name: frame.matrix() for name, frame in frames.items()}

    return Measurement(
        openness={name: part.openness for name, part in articulated.items()},
        joint_speed={name: part.joint_speed for name, part in articulated.items()},
        keypoints={name: part.keypoints() for name, part in parts.items()},
        poses={name: part.pose for name, part in rigid.items()},
        speeds={name: part.speeds for name, part in rigid.items()},
        gripper=robot.gripper(),
        finger_opening=robot.finger_opening,
        start_positions={name: part.thing.position for name, part in rigid.items()},
        bounds=LazyMapping(lambda: bounds_of(models, poses())),
        contents=LazyMapping(lambda: contents_of(models, poses())),
    )


def read_scene(robot: RobotReader, parts: Parts) -> Scene:
    """Return the planner's scene in the robot's base frame.

    The simulator does not know which object is grasped, so the caller must add the name of the grasped object.
    """
    # Read the pose of the robot's base from the profile, because the simulator rounds this pose to float32.
    T_world_base = robot.profile.T_world_base
    T_base_world = np.asarray(np.linalg.inv(T_world_base), dtype=np.float64)
    return Scene(
        q=robot.q,
        qvel=robot.qvel,
        T_world_base=T_world_base,
        objects={name: part.scene_object(T_base_world) for name, part in parts.items()},
        fixtures=(_table(T_base_world),),
        finger_friction=robot.finger_friction,
        finger_stiffness=robot.finger_stiffness,
    )


def _table(T_base_world: Array) -> SceneBody:
    T_world_table = np.eye(4)
    T_world_table[2, 3] = -HALF_SIZE[2]
    return SceneBody("table", _TABLE_HULLS, T_base_world @ T_world_table)


class SceneAccessMixin:
    """Mixin for access to the robot and the objects of the current scene."""

    _initial_state: InitialState | None = None
    _parts: Mapping[str, Part]
    _robot: RobotReader | StandingRobot

    def _require_open(self) -> None:
        """Raise an error if the environment is closed."""

    @property
    def initial_state(self) -> InitialState:
        self._require_open()
        if self._initial_state is None:
            raise GenSim2Error("the environment has not been reset yet")
        return self._initial_state

    @property
    def parts(self) -> Mapping[str, Part]:
        """Objects in the scene by name."""
        assert self.initial_state
        return self._parts

    @property
    def object_warnings(self) -> tuple[str, ...]:
        """Warnings from building the objects."""
        return tuple(f"{part.name}: {warning}" for part in self.parts.values() for warning in part.warnings)

    def measure(self) -> Measurement:
        """Measure the state in the world frame. Without a robot, the robot's part of the state is its start pose."""
        return measure(self._robot, self.parts)

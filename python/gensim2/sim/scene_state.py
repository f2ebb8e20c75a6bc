"""From the simulator to values: :class:`~gensim2.planning.scene.Scene` and :class:`Measurement`, in float64."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import GenSim2Error
from gensim2.planning.scene import Scene, SceneBody
from gensim2.robots import RobotProfile
from gensim2.scenes.initial_state import InitialState
from gensim2.scenes.table import HALF_SIZE, corners
from gensim2.sim.parts import ArticulatedPart, Frame, LazyMapping, Part, Parts, RigidPart
from gensim2.tasks.measurement import Measurement

Array = npt.NDArray[np.float64]

_TABLE_HULLS = (corners(),)


class RobotReader(ABC):
    """Reader of a robot's state in a scene; each engine has a subclass.

    Args:
        profile: of the robot.
    """

    def __init__(self, profile: RobotProfile) -> None:
        self.profile = profile

    @property
    @abstractmethod
    def q(self) -> Array:
        """(n,) joints, rad and m, in the profile's active joint order."""

    @property
    @abstractmethod
    def qvel(self) -> Array:
        """(n,) their velocities."""

    @abstractmethod
    def hand(self) -> Frame:
        """Pose of the hand at this instant."""

    @property
    @abstractmethod
    def finger_friction(self) -> float:
        """Coefficient of the fingers' surface."""

    @property
    @abstractmethod
    def finger_stiffness(self) -> float:
        """Of the drives that press the pads together, N/m or N m/rad."""

    def gripper(self) -> Mapping[str, Array]:
        """Tool keypoints in the world, (3,) m."""
        hand = self.hand()
        return LazyMapping(lambda: self.profile.gripper_at(hand.matrix()))

    @property
    def finger_opening(self) -> float:
        """Distance between the fingers' pads, m."""
        return self.profile.gripper.opening(self.q[self.profile.arm_size :])


class StandingRobot:
    """Robot of a scene that was built without it: it counts as standing at its start, its fingers open.

    Args:
        profile: of the robot.
        start: (n,) all active joints at the start of the episode.
    """

    def __init__(self, profile: RobotProfile, start: Sequence[float]) -> None:
        self._profile, self._start = profile, start

    def gripper(self) -> Mapping[str, Array]:
        """Tool keypoints in the world, (3,) m."""
        return self._profile.gripper_with(self._start)

    @property
    def finger_opening(self) -> float:
        """Distance between the fingers' pads, m."""
        return self._profile.gripper.widest


def measure(robot: RobotReader | StandingRobot, parts: Parts) -> Measurement:
    """Measure the present instant in the world frame, for criteria and verdicts."""
    articulated = {name: part for name, part in parts.items() if isinstance(part, ArticulatedPart)}
    rigid = {name: part for name, part in parts.items() if isinstance(part, RigidPart)}
    return Measurement(
        openness={name: part.openness for name, part in articulated.items()},
        joint_speed={name: part.joint_speed for name, part in articulated.items()},
        keypoints={name: part.keypoints() for name, part in parts.items()},
        poses={name: part.pose for name, part in rigid.items()},
        speeds={name: part.speeds for name, part in rigid.items()},
        gripper=robot.gripper(),
        finger_opening=robot.finger_opening,
        start_positions={name: part.thing.position for name, part in rigid.items()},
    )


def read_scene(robot: RobotReader, parts: Parts) -> Scene:
    """Return the poses of everything in the robot's base frame; what the hand holds is for the caller to know."""
    T_world_base = robot.profile.T_world_base  # exact: the simulator's own value is rounded to float32
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
    """Access to the robot and the objects of the scene of the last reset."""

    _initial_state: InitialState | None = None
    _parts: Mapping[str, Part]
    _robot: RobotReader | StandingRobot

    def _require_open(self) -> None:
        """Refuse to go on with what was closed."""

    @property
    def initial_state(self) -> InitialState:
        """Initial state that was drawn at the last reset."""
        self._require_open()
        if self._initial_state is None:
            raise GenSim2Error("the environment has not been reset yet")
        return self._initial_state

    @property
    def parts(self) -> Mapping[str, Part]:
        """The objects as they stand in the scene, by name."""
        assert self.initial_state
        return self._parts

    @property
    def object_warnings(self) -> tuple[str, ...]:
        """Losses in building the objects, by object."""
        return tuple(f"{part.name}: {warning}" for part in self.parts.values() for warning in part.warnings)

    def measure(self) -> Measurement:
        """Measure the present instant in the world frame, for criteria and verdicts; without an arm, as if it stood
        still."""
        return measure(self._robot, self.parts)

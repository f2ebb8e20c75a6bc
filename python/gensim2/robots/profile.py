"""Describe a robot for planning, control and simulation; no simulator is needed to read a profile."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array
from gensim2.robots.gripper import OPEN, Gripper, Row

if TYPE_CHECKING:
    import gensim2_kpam as kpam


DEFAULT_ROBOT = "panda"
"""Name of the robot that is used if none is given."""


FINGER_KEYPOINTS = {
    "tool_head": "the middle point between the two finger tips",
    "tool_tail": "the middle point between the two finger bases",
    "tool_side": "the tip of the right finger",
}
"""Tool keypoints of a gripper with two fingers."""


def finger_keypoints(tip: float, side: float, base: float | None = None) -> dict[str, Array]:
    """Return the keypoints of a two-finger gripper by name, as positions (3,) in the hand frame, m.

    Args:
        tip: distance of the fingertips from the hand's origin along z, m.
        side: distance between the right finger and the middle of the open gripper, m.
        base: distance of the finger bases from the hand's origin along z, m. The default is 3 cm less than ``tip``.

    Example:
        ```python
        keypoints = finger_keypoints(0.105, 0.053)    # keypoints of the Panda
        ```
    """
    base = tip - 0.03 if base is None else base
    places = ((0.0, 0.0, tip), (0.0, 0.0, base), (0.0, side, tip))
    return {name: np.array(place) for name, place in zip(FINGER_KEYPOINTS, places, strict=True)}


def _no_options() -> kpam.Options:
    """Return empty solver options; the solver then takes all limits from the URDF."""
    return {}


@dataclass(frozen=True)
class Footprint:
    """Space on and above the table that a robot occupies at the start, m. Objects must stay out of it.

    Attributes:
        base_half: half the side length of the square that the base occupies.
        hand_half: half the side length of the square below the hand.
        hand_drop: distance by which the space of the hand extends below the resting tool. Objects below it must be
            lower.
    """

    base_half: float
    hand_half: float
    hand_drop: float


@dataclass(frozen=True)
class JointDrive:
    """PD drive of a joint, with stiffness, damping and force limit.

    The units are N m/rad, N m s/rad and N m for a revolute joint, and N/m, N s/m and N for a prismatic joint.
    """

    stiffness: float
    damping: float
    force_limit: float

    @property
    def lag(self) -> float:
        """Time (s) by which the joint lags behind a target that moves at constant velocity: damping / stiffness."""
        return self.damping / self.stiffness


@dataclass(frozen=True)
class Simulation:
    """Parameters for simulating a robot. In simulation, PD drives take the place of the motors.

    Attributes:
        agent: ManiSkill agent, which recorded states name. :mod:`gensim2.sim.agents` creates an agent that ManiSkill
            lacks.
        arm: one drive for all arm joints, or a tuple with one drive for each joint.
        gripper: drive of the driven gripper joints.
        mimic: drive of the joints that follow the driven gripper joints. A stiff drive represents a rigid transmission.
        passive: drive of the joints without a motor, which acts as a spring that pulls the joint to 0.
        tendons: whether fixed tendons couple the mimic joints of the URDF in PhysX. ``gripper.mimics`` need no tendons.
        physics_hz: simulation rate in Hz; a multiple of the control rate.
    """

    agent: str
    arm: JointDrive | tuple[JointDrive, ...]
    gripper: JointDrive
    mimic: JointDrive = JointDrive(2e3, 1e2, 200.0)
    passive: JointDrive = JointDrive(0.0, 0.1, 1e10)
    tendons: bool = False
    physics_hz: int = 100


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Maximum velocity, acceleration and jerk (m,) of the m arm joints, in rad or m, per s, s^2 and s^3."""

    velocity: Array
    acceleration: Array
    jerk: Array


@dataclass(frozen=True, eq=False)
class MountedCamera:
    """A camera mounted on a link of the robot.

    Attributes:
        name: unique name, different from the names of the fixed cameras.
        link: name of the link.
        T_link_camera: (4, 4) pose in the OpenCV convention: x to the right of the image, y down, z forward; m.
        width, height: pixels.
        field_of_view: vertical field of view, rad.
    """

    name: str
    link: str
    T_link_camera: Array
    width: int = 128
    height: int = 128
    field_of_view: float = 1.2


@dataclass(frozen=True)
class RobotFiles:
    """Description files of a robot.

    Attributes:
        urdf: URDF file.
        srdf: SRDF file with the pairs of links that never touch. Its name and folder are those of the URDF, where
            simulators look for it.
    """

    urdf: Path
    srdf: Path


@dataclass(frozen=True)
class RobotProfile:
    """Static description of a robot for planning, control and simulation.

    An action is (m + 1,): targets of the m arm joints in rad or m, and the gripper from -1 (closed) to 1 (open).

    In every hand frame, z points along the fingers, which open along y. Therefore a config fits every robot.

    Attributes:
        name: name of the robot, as given to the option ``--robot``.
        files: function that returns the description files; it raises an error if a package that they need is missing.
        hand_link: link of the hand frame, in which tool keypoints and hand poses are given.
        tool_link: link whose pose is part of state observations.
        arm_joints: names of the m joints that an action commands, in active joint order, before the gripper's joints.
        gripper: gripper of the robot.
        reset_qpos: (n,) positions of all active joints at the start of an episode.
        base_position: (3,) position of the base in the world, m.
        tool_keypoints: positions (3,) of the keypoints ``tool_head``, ``tool_tail`` and ``tool_side`` in the hand
            frame, by name, m; see :func:`finger_keypoints`.
        reach: maximum horizontal distance (m) from the base at which the hand can touch the table while it points down.
        footprint: space that the robot occupies on and above the table at the start of an episode.
        simulation: simulation parameters.
        base_quaternion: (4,) orientation of the base in the world, (w, x, y, z).
        control_hz: control rate, Hz.
        cameras: cameras mounted on the robot's links, in addition to the fixed cameras.
        tool_keypoint_descriptions: description of each tool keypoint, for people and for prompts to language models.
        solver: options of all planning problems, such as limits, joint weights, and the box of the hand at the
            actuation pose.
    """

    name: str
    files: Callable[[], RobotFiles]
    hand_link: str
    tool_link: str
    arm_joints: tuple[str, ...]
    gripper: Gripper
    reset_qpos: tuple[float, ...]
    base_position: tuple[float, float, float]
    tool_keypoints: Mapping[str, Array]
    reach: float
    footprint: Footprint
    simulation: Simulation
    base_quaternion: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    control_hz: int = 20
    cameras: tuple[MountedCamera, ...] = ()
    tool_keypoint_descriptions: Mapping[str, str] = field(default_factory=FINGER_KEYPOINTS.copy)
    solver: kpam.Options = field(default_factory=_no_options)

    @cached_property
    def _files(self) -> RobotFiles:
        return self.files()

    @property
    def urdf(self) -> Path:
        """URDF for planning and simulation.

        Raises:
            MissingExtraError: the file belongs to a package that is not installed.
        """
        return self._files.urdf

    @property
    def srdf(self) -> Path:
        """SRDF with the pairs of links that never touch.

        Raises:
            MissingExtraError: the file belongs to a package that is not installed.
        """
        return self._files.srdf

    @cached_property
    def model(self) -> kpam.Robot:
        """The planner's model of the robot, loaded once in each process.

        Raises:
            MissingExtraError: the robot's files belong to a package that is not installed.
        """
        import gensim2_kpam as kpam

        return kpam.Robot.from_urdf(self.urdf, hand_link=self.hand_link, srdf=self.srdf)

    @property
    def arm_size(self) -> int:
        """Number m of arm joints, which are the first m active joints."""
        return len(self.arm_joints)

    @property
    def action_size(self) -> int:
        """Size of an action, m + 1."""
        return self.arm_size + 1

    @cached_property
    def T_world_base(self) -> Array:
        """Pose (4, 4) of the base in the world."""
        pose = np.eye(4)
        pose[:3, :3] = rotation_matrix(self.base_quaternion)
        pose[:3, 3] = self.base_position
        return pose

    @property
    def agent(self) -> str:
        """Name of the ManiSkill agent, which identifies the robot in recorded states."""
        return self.simulation.agent

    @cached_property
    def arm_drives(self) -> tuple[JointDrive, ...]:
        """Drive of each of the m arm joints in simulation."""
        drives = self.simulation.arm
        return (drives,) * self.arm_size if isinstance(drives, JointDrive) else drives

    @property
    def finger_drive(self) -> JointDrive:
        """Drive that presses a finger pad in simulation."""
        follows = self.gripper.fingers[0] in self.gripper.mimics
        return self.simulation.mimic if follows else self.simulation.gripper

    @property
    def substeps(self) -> int:
        """Number of physics steps in a control step."""
        return self.simulation.physics_hz // self.control_hz

    @cached_property
    def arm_columns(self) -> tuple[int, ...]:
        """Indices of the m arm joints among all active joints."""
        names = self.model.joint_names
        return tuple(names.index(name) for name in self.arm_joints)

    @cached_property
    def gripper_columns(self) -> tuple[int, ...]:
        """Indices of the g gripper joints among all active joints."""
        names = self.model.joint_names
        return tuple(names.index(name) for name in self.gripper.joints)

    def arm_limits(self, acceleration: npt.ArrayLike, jerk: npt.ArrayLike) -> JointLimits:
        """Return the limits of the arm's joints from the solver options.

        If the solver options have no limits, the URDF has the velocity limits, and the arguments are the limits of
        acceleration and jerk.

        Args:
            acceleration, jerk: limits (m,), or one number for all joints; used if the solver options have no limits.
        """

        def own(given: npt.ArrayLike | None, usual: npt.ArrayLike) -> Array:
            arm = usual if given is None else np.asarray(given, dtype=np.float64)[list(self.arm_columns)]
            return np.array(np.broadcast_to(arm, self.arm_size), dtype=np.float64)

        return JointLimits(
            own(self.solver.get("velocity_limits"), self.model.velocity[list(self.arm_columns)]),
            own(self.solver.get("acceleration_limits"), acceleration),
            own(self.solver.get("jerk_limits"), jerk),
        )

    def gripper_at(self, T_world_hand: Array) -> dict[str, Array]:
        """Return the tool keypoints (3,) by name, world frame, m, for the hand pose ``T_world_hand`` (4, 4)."""
        points = self._tool_points @ T_world_hand[:3, :3].T + T_world_hand[:3, 3]
        return dict(zip(self.tool_keypoints, points, strict=True))

    @cached_property
    def _tool_points(self) -> Array:
        """Return the tool keypoints (N, 3) in the hand frame."""
        return np.array(list(self.tool_keypoints.values()), dtype=np.float64)

    def gripper_with(self, q: Sequence[float]) -> dict[str, Array]:
        """Return the positions of the tool keypoints by name, each (3,) in the world frame, m.

        ``q`` (n,) are the positions of all active joints.
        """
        return self.gripper_at(self.T_world_base @ self.model.forward_kinematics(np.asarray(q, dtype=np.float64)))

    @cached_property
    def lags(self) -> Array:
        """Tracking delays (m,) in seconds of the arm's simulated drives."""
        return np.array([drive.lag for drive in self.arm_drives])

    @cached_property
    def lag_steps(self) -> tuple[int, ...]:
        """Tracking delays (m,) in control steps."""
        return tuple(round(float(lag) * self.control_hz) for lag in self.lags)

    @property
    def arrival_steps(self) -> int:
        """Number of control steps for the arm to settle after a stop."""
        return max(self.lag_steps)

    def simulated_targets(self, positions: Row, ends: npt.NDArray[np.int64]) -> Row:
        """Return joint targets that compensate the tracking delay of the simulated drives.

        The target of a step is the desired position of a later step, so that the joint, which lags, is there in time.

        Args:
            positions: (N, m) desired arm joints at the end of each control step.
            ends: (N,) index of the last step of the motion to which each step belongs. No target comes from after this
                step.

        Returns:
            (N, m) joint targets, one row for each control step.
        """
        rows = np.minimum(np.arange(len(positions))[:, None] + np.array(self.lag_steps), ends[:, None])
        targets: Row = positions[rows, np.arange(self.arm_size)]
        return targets

    @property
    def gripper_steps(self) -> int:
        """Number of control steps for opening or closing the fingers."""
        return self.steps(self.gripper.travel_seconds)

    def steps(self, seconds: float) -> int:
        """Return the number of control steps in ``seconds``."""
        return round(seconds * self.control_hz)

    @property
    def rest_action(self) -> npt.NDArray[np.float32]:
        """Action (m + 1,) that keeps the arm at its start pose with open fingers."""
        return np.array([*self.reset_qpos[: self.arm_size], OPEN], dtype=np.float32)


def rotation_matrix(quaternion: Sequence[float] | Array) -> Array:
    """Return the rotation matrix (3, 3) of a unit quaternion (w, x, y, z)."""
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )

"""Profile of a robot: numbers and names only, read without a simulator."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from gensim2.robots.gripper import OPEN, Gripper, Row

if TYPE_CHECKING:
    import gensim2_kpam as kpam

Array = npt.NDArray[np.float64]

DEFAULT_ROBOT = "panda"
"""Name of the robot where no other one is named."""


FINGER_KEYPOINTS = {
    "tool_head": "the middle point between the two finger tips",
    "tool_tail": "the middle point between the two finger bases",
    "tool_side": "the tip of the right finger",
}
"""Tool keypoints of a gripper with two fingers."""


def finger_keypoints(tip: float, side: float, base: float | None = None) -> dict[str, Array]:
    """Return the tool keypoints of a gripper with two fingers, (3,) each in the hand frame, m.

    Args:
        tip: height of the fingertips above the hand's origin, m.
        side: distance of the open right finger from the middle, m.
        base: height of the finger bases, m; None: 3 cm below the tips.
    """
    base = tip - 0.03 if base is None else base
    places = ((0.0, 0.0, tip), (0.0, 0.0, base), (0.0, side, tip))
    return {name: np.array(place) for name, place in zip(FINGER_KEYPOINTS, places, strict=True)}


def _no_options() -> kpam.Options:
    """Options of a solver that knows nothing of the robot but its URDF."""
    return {}


@dataclass(frozen=True)
class Footprint:
    """Footprint of a robot on the table at the start of an episode; metres.

    Attributes:
        base_half, hand_half: half sides of what its base covers on the table, and its hand at rest.
        hand_drop: below the tool at rest that what passes under it keeps.
    """

    base_half: float
    hand_half: float
    hand_drop: float


@dataclass(frozen=True)
class JointDrive:
    """PD drive of a joint: N m/rad, N m s/rad and N m, or N/m, N s/m and N."""

    stiffness: float
    damping: float
    force_limit: float

    @property
    def lag(self) -> float:
        """Steady-state tracking delay (s) behind a target of constant velocity: kd/kp."""
        return self.damping / self.stiffness


@dataclass(frozen=True)
class Simulation:
    """Simulation parameters of a robot: drives in the place of its motors.

    Attributes:
        agent: name of ManiSkill's agent, under which states are recorded; where ManiSkill has none of that name,
            :mod:`gensim2.sim.agents` makes one of the profile.
        arm: drives of the arm's joints: one for all, or one each.
        gripper: of the driven joints of the gripper.
        mimic: of the joints that follow one of them: a stiff one stands for a transmission.
        passive: of the joints that have no motor: a spring to 0.
        tendons: whether PhysX couples joints that mimic one another in the URDF by fixed tendons, as ManiSkill's own
            agents have them; those of ``gripper.mimics`` need none.
        physics_hz: rate of the physics; a multiple of the control rate.
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
    """(m,) velocities, accelerations and jerks of an arm's joints: rad or m, per second, second squared and cubed."""

    velocity: Array
    acceleration: Array
    jerk: Array


@dataclass(frozen=True, eq=False)
class MountedCamera:
    """A camera that a link of the robot carries.

    Attributes:
        name: unique among those of the robot; none of the fixed cameras'.
        link: that carries it.
        T_link_camera: (4, 4) as OpenCV has cameras: x to the right of the picture, y down, z forward; m.
        width, height: pixels.
        field_of_view: rad, of the picture's height.
    """

    name: str
    link: str
    T_link_camera: Array
    width: int = 128
    height: int = 128
    field_of_view: float = 1.2


@dataclass(frozen=True)
class RobotFiles:
    """A robot's description: ``urdf``, and ``srdf`` with its pairs of links that never touch, which lies beside it
    under the same name (where simulators look for it)."""

    urdf: Path
    srdf: Path


@dataclass(frozen=True)
class RobotProfile:
    """One robot.

    An action is (m + 1,): targets of the m arm joints in rad or m, and the gripper from -1 (closed) to 1 (open).

    The hand frame is the same for every robot: z the way the fingers point, y the axis along which they open, so that a
    solver config means the same motion whoever executes it.

    Attributes:
        name: as in ``--robot``.
        files: gives its description; a function, since that may come with a package that need not be installed.
        hand_link: whose frame tool keypoints and hand poses are in.
        tool_link: whose pose state observations give.
        arm_joints: names of the m joints that an action commands, in active joint order; the gripper's come after them.
        gripper: what opens and closes.
        reset_qpos: (n,) all active joints at the start of an episode.
        base_position: (3,) of its base in the world, m.
        tool_keypoints: (3,) each, m in the hand frame; ``tool_head``, ``tool_tail``, ``tool_side``. See
            :func:`finger_keypoints`.
        reach: horizontal distance (m) from the base within which the hand, pointing down, reaches the table.
        footprint: what it covers of the table at rest.
        simulation: what stands for its motors in a simulation.
        base_quaternion: (4,) of its base in the world, (w, x, y, z).
        control_hz: rate of its actions.
        cameras: that its links carry, beside the fixed ones.
        tool_keypoint_descriptions: descriptions of the tool keypoints for people and language models.
        solver: options of every planning problem: limits that no URDF holds, the joints' weights, the box of the hand's
            origin at the actuation pose.
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
        """URDF that planning and simulation read.

        Raises:
            MissingExtraError: it comes with a package that is not installed.
        """
        return self._files.urdf

    @property
    def srdf(self) -> Path:
        """Its pairs of links that never touch.

        Raises:
            MissingExtraError: it comes with a package that is not installed.
        """
        return self._files.srdf

    @cached_property
    def model(self) -> kpam.Robot:
        """The planner's robot, read once a process.

        Raises:
            MissingExtraError: its files come with a package that is not installed.
        """
        import gensim2_kpam as kpam

        return kpam.Robot.from_urdf(self.urdf, hand_link=self.hand_link, srdf=self.srdf)

    @property
    def arm_size(self) -> int:
        """m, the number of arm joints: the first m of all active joints."""
        return len(self.arm_joints)

    @property
    def action_size(self) -> int:
        """m + 1."""
        return self.arm_size + 1

    @cached_property
    def T_world_base(self) -> Array:
        """(4, 4) base in the world."""
        pose = np.eye(4)
        pose[:3, :3] = rotation_matrix(self.base_quaternion)
        pose[:3, 3] = self.base_position
        return pose

    @property
    def agent(self) -> str:
        """Name under which its states are recorded."""
        return self.simulation.agent

    @cached_property
    def arm_drives(self) -> tuple[JointDrive, ...]:
        """One for each of the m arm joints, in a simulation."""
        drives = self.simulation.arm
        return (drives,) * self.arm_size if isinstance(drives, JointDrive) else drives

    @property
    def finger_drive(self) -> JointDrive:
        """Drive, in a simulation, that presses a pad."""
        follows = self.gripper.fingers[0] in self.gripper.mimics
        return self.simulation.mimic if follows else self.simulation.gripper

    @property
    def substeps(self) -> int:
        """Physics steps in a control step."""
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
        """Limits of the arm's joints, those of the solver's options where the robot has such.

        Args:
            acceleration, jerk: (m,) or one for all, where it has none. Velocities are the URDF's then.
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
        """Tool keypoints in the world, (3,) m each, where the hand stands at ``T_world_hand`` (4, 4)."""
        points = self._tool_points @ T_world_hand[:3, :3].T + T_world_hand[:3, 3]
        return dict(zip(self.tool_keypoints, points, strict=True))

    @cached_property
    def _tool_points(self) -> Array:
        """(N, 3) tool keypoints in the hand."""
        return np.array(list(self.tool_keypoints.values()), dtype=np.float64)

    def gripper_with(self, q: Sequence[float]) -> dict[str, Array]:
        """Tool keypoints in the world, (3,) m each, where the (n,) active joints stand at ``q``."""
        return self.gripper_at(self.T_world_base @ self.model.forward_kinematics(np.asarray(q, dtype=np.float64)))

    @cached_property
    def lags(self) -> Array:
        """(m,) tracking delays (s) of the arm's simulated drives."""
        return np.array([drive.lag for drive in self.arm_drives])

    @cached_property
    def lag_steps(self) -> tuple[int, ...]:
        """(m,) the same in control steps."""
        return tuple(round(float(lag) * self.control_hz) for lag in self.lags)

    @property
    def arrival_steps(self) -> int:
        """Control steps that the arm is given to arrive where it stops."""
        return max(self.lag_steps)

    def simulated_targets(self, positions: Row, ends: npt.NDArray[np.int64]) -> Row:
        """Targets by which the simulated drives bring the arm where it is meant to be: each ahead by its drive's delay.

        Args:
            positions: (N, m) of the arm joints that are meant at the end of each control step.
            ends: (N,) row up to which the motion goes that a row is part of; no target lies beyond it.

        Returns:
            (N, m) targets of each control step.
        """
        rows = np.minimum(np.arange(len(positions))[:, None] + np.array(self.lag_steps), ends[:, None])
        targets: Row = positions[rows, np.arange(self.arm_size)]
        return targets

    @property
    def gripper_steps(self) -> int:
        """Control steps that the fingers are given to open or to close."""
        return self.steps(self.gripper.travel_seconds)

    def steps(self, seconds: float) -> int:
        """Control steps in so many seconds."""
        return round(seconds * self.control_hz)

    @property
    def rest_action(self) -> npt.NDArray[np.float32]:
        """(m + 1,): the arm stays where an episode begins, fingers open."""
        return np.array([*self.reset_qpos[: self.arm_size], OPEN], dtype=np.float32)


def rotation_matrix(quaternion: Sequence[float] | Array) -> Array:
    """Return the (3, 3) rotation of a unit quaternion (w, x, y, z)."""
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )

"""What the project knows of a robot: numbers and names only, read without a simulator."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from gensim2.errors import InputError

if TYPE_CHECKING:
    import gensim2_kpam as kpam

Array = npt.NDArray[np.float64]

OPEN, CLOSED = 1.0, -1.0
"""Gripper commands: the last number of an action."""

DEFAULT_ROBOT = "panda"
"""Name of the robot where nobody says otherwise."""


@dataclass(frozen=True)
class Gripper:
    """Two fingers that move equally far.

    Attributes:
        joints: names of the finger joints, in the robot's active joint order.
        links: the fingers themselves.
        open, closed: targets (m) of a finger joint for the commands 1 and -1; the closed one presses.
        travel_seconds: time that the fingers are given to open or to close.
        stiffness, damping, force_limit: of the finger drives: N/m, N s/m, N.
        friction: coefficient of the fingers' surface, static and dynamic.
    """

    joints: tuple[str, ...]
    links: tuple[str, ...]
    open: float
    closed: float
    travel_seconds: float
    stiffness: float
    damping: float
    force_limit: float
    friction: float

    def target(self, command: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Targets (m) of a finger joint for commands of any shape, in ManiSkill's arithmetic, bit for bit."""
        low, high, half = np.float32(self.closed), np.float32(self.open), np.float32(0.5)
        clipped = np.clip(command, np.float32(CLOSED), np.float32(OPEN))
        return half * (high + low) + half * (high - low) * clipped

    def command(self, target: float) -> float:
        """The command that sends a finger joint to ``target`` (m)."""
        return (2.0 * target - self.open - self.closed) / (self.open - self.closed)


@dataclass(frozen=True)
class Workspace:
    """Where a robot likes its objects; metres, horizontal.

    Attributes:
        comfortable: distance from the base of what the hand works on, mean over its range.
        farthest: the same anywhere in its range; being clear of the hand gives way to it.
        sideways: how far off the robot's middle line that may lie.
        nearest_x: in the world: nothing of a low object comes closer to the base.
        hand_at_rest: x and y in the world of the hand at the start of an episode.
        hand_low_point: height above the table: what is lower passes under the hand at rest.
        hand_clearance: ahead of the hand at rest, what anything tall keeps: the hand's thickness and the randomization.
        hand_half_width: to each side of the hand at rest where that holds: its width and the randomization.
        base_half, hand_half: half sides of what its base covers on the table, and its hand at rest.
        hand_drop: below the tool at rest that what passes under it keeps.
    """

    comfortable: float
    farthest: float
    sideways: float
    nearest_x: float
    hand_at_rest: tuple[float, float]
    hand_low_point: float
    hand_clearance: float
    hand_half_width: float
    base_half: float
    hand_half: float
    hand_drop: float


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
        agent: of ManiSkill: ``robot_uids``.
        files: gives its description; a function, since that comes with a package that need not be installed.
        hand_link: whose frame tool keypoints and hand poses are in.
        tool_link: whose pose state observations give.
        arm_joints: names of the m joints that an action commands, in active joint order; fingers come after them.
        gripper: the fingers.
        reset_qpos: (n,) all active joints at the start of an episode.
        base_position: (3,) of its base in the world, m; no rotation.
        tool_keypoints: (3,) each, m in the hand frame; ``tool_head``, ``tool_tail``, ``tool_side``.
        tool_keypoint_descriptions: what a person or a language model is told of them.
        reach: horizontal distance (m) from the base within which the hand, pointing down, reaches the table.
        stiffness, damping, force_limit: of the arm's drives: N m/rad, N m s/rad, N m.
        workspace: where it likes its objects.
        solver: options of every planning problem: limits that no URDF holds, the joints' weights, the box of the hand's
            origin at the actuation pose.
        physics_hz, control_hz: rates.
    """

    name: str
    agent: str
    files: Callable[[], RobotFiles]
    hand_link: str
    tool_link: str
    arm_joints: tuple[str, ...]
    gripper: Gripper
    reset_qpos: tuple[float, ...]
    base_position: tuple[float, float, float]
    tool_keypoints: Mapping[str, Array]
    tool_keypoint_descriptions: Mapping[str, str]
    reach: float
    stiffness: float
    damping: float
    force_limit: float
    workspace: Workspace
    solver: kpam.Options
    physics_hz: int = 100
    control_hz: int = 20

    @cached_property
    def _files(self) -> RobotFiles:
        return self.files()

    @property
    def urdf(self) -> Path:
        """What planning and simulation read.

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

    @property
    def T_world_base(self) -> Array:
        """(4, 4) base in the world."""
        pose = np.eye(4)
        pose[:3, 3] = self.base_position
        return pose

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

    @property
    def lag(self) -> float:
        """Seconds by which a drive follows a target that moves evenly: damping over stiffness."""
        return self.damping / self.stiffness

    @property
    def lag_steps(self) -> int:
        """The lag in control steps, by which targets are sent ahead."""
        return round(self.lag * self.control_hz)

    @property
    def gripper_steps(self) -> int:
        """Control steps that the fingers are given to open or to close."""
        return round(self.gripper.travel_seconds * self.control_hz)

    @property
    def rest_action(self) -> npt.NDArray[np.float32]:
        """(m + 1,): the arm stays where an episode begins, fingers open."""
        return np.array([*self.reset_qpos[: self.arm_size], OPEN], dtype=np.float32)


_MODULES = {"panda": "gensim2.robots.panda", "fetch": "gensim2.robots.fetch"}
"""Where a function of the robot's name makes its profile; imported when asked for."""


def robot_names() -> tuple[str, ...]:
    """Names of the robots that there are."""
    return tuple(_MODULES)


@cache
def robot(name: str = DEFAULT_ROBOT) -> RobotProfile:
    """The profile of a robot.

    Raises:
        InputError: there is no such robot.
    """
    if name not in _MODULES:
        raise InputError(f"no robot {name!r}", field="robot", remedy=f"one of {', '.join(_MODULES)}")
    profile: RobotProfile = getattr(importlib.import_module(_MODULES[name]), name)()
    return profile

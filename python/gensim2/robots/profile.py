"""What the project knows of a robot: numbers and names only, read without a simulator."""

from __future__ import annotations

from collections.abc import Callable, Mapping
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


@dataclass(frozen=True)
class Gripper:
    """Two fingers that move equally far.

    Attributes:
        joints: names of the finger joints, in the robot's active joint order.
        open, closed: targets (m) of a finger joint for the commands 1 and -1; the closed one presses.
        stiffness, damping, force_limit: of the finger drives.
    """

    joints: tuple[str, ...]
    open: float
    closed: float
    stiffness: float
    damping: float
    force_limit: float


@dataclass(frozen=True)
class RobotProfile:
    """One robot.

    An action is (m + 1,): targets of the m arm joints in rad or m, and the gripper from -1 (closed) to 1 (open).

    Attributes:
        name: as in ``--robot`` and as ManiSkill's agent.
        urdf: what planning reads; ``srdf``: its pairs that never touch, or None.
        hand_link: whose frame tool keypoints and hand poses are in.
        arm_joints: names of the m joints that an action commands.
        gripper: the fingers.
        reset_qpos: (n,) all active joints at the start of an episode.
        base_position: (3,) of its base in the world, m; no rotation.
        tool_keypoints: (3,) each, m in the hand frame; ``tool_head``, ``tool_tail``, ``tool_side``.
        tool_keypoint_descriptions: what a person or a language model is told of them.
        reach: horizontal distance (m) from the base within which the hand, pointing down, reaches the table.
        stiffness, damping, force_limit: of the arm's drives.
        physics_hz, control_hz: rates.
    """

    name: str
    urdf: Path
    srdf: Path | None
    hand_link: str
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
    physics_hz: int = 100
    control_hz: int = 20

    @cached_property
    def model(self) -> kpam.Robot:
        """The planner's robot, read once a process."""
        import gensim2_kpam as kpam

        return kpam.Robot.from_urdf(self.urdf, hand_link=self.hand_link, srdf=self.srdf)

    @property
    def T_world_base(self) -> Array:
        """(4, 4) base in the world."""
        pose = np.eye(4)
        pose[:3, 3] = self.base_position
        return pose

    def gripper_at(self, T_world_hand: Array) -> dict[str, Array]:
        """Tool keypoints in the world, (3,) m each, where the hand stands at ``T_world_hand`` (4, 4)."""
        turn, place = T_world_hand[:3, :3], T_world_hand[:3, 3]
        return {name: np.asarray(turn @ point + place) for name, point in self.tool_keypoints.items()}

    @cached_property
    def gripper_at_rest(self) -> Mapping[str, Array]:
        """Tool keypoints in the world at the start of an episode, (3,) m each."""
        return self.gripper_at(self.T_world_base @ self.model.forward_kinematics(np.array(self.reset_qpos)))

    @property
    def lag(self) -> float:
        """Seconds by which a drive follows a target that moves evenly: damping over stiffness."""
        return self.damping / self.stiffness

    @property
    def lag_steps(self) -> int:
        """The lag in control steps, by which targets are sent ahead."""
        return round(self.lag * self.control_hz)


def robot_names() -> tuple[str, ...]:
    """Names of the robots that there are."""
    return tuple(_makers())


@cache
def robot(name: str) -> RobotProfile:
    """The profile of a robot.

    Raises:
        InputError: there is no such robot.
        MissingExtraError: its model comes with a package that is not installed.
    """
    makers = _makers()
    if name not in makers:
        raise InputError(f"no robot {name!r}", field="robot", remedy=f"one of {', '.join(makers)}")
    return makers[name]()


def _makers() -> Mapping[str, Callable[[], RobotProfile]]:
    from gensim2.robots.panda import panda  # here: it needs the class above

    return {"panda": panda}

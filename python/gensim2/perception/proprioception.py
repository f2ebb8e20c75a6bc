"""Proprioception of a robot, from its joints: one function for simulators, recordings and robots."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import numpy.typing as npt

from gensim2.perception.columns import GRIPPER, STATE, TOOL_POSE, VELOCITY
from gensim2.robots import RobotProfile

Row = npt.NDArray[np.float32]


class Proprioception(Mapping[str, Row]):
    """``state``, ``velocity``, ``tool_pose`` and ``gripper`` of one instant (:mod:`gensim2.perception.columns`).

    The last two are worked out on first access: few controllers look at them every step, and a pose of the tool costs
    a tenth of a control step. Pickles as a dict.

    Args:
        profile: of the robot.
        positions, velocities: (n,) of all active joints, rad and m, and a second.
        command: the gripper's last, -1 to 1.
    """

    def __init__(
        self, profile: RobotProfile, positions: npt.ArrayLike, velocities: npt.ArrayLike, command: float
    ) -> None:
        self._profile, self._command = profile, command
        self._rows = {
            STATE: np.array(positions, dtype=np.float32),
            VELOCITY: np.array(velocities, dtype=np.float32),
        }

    def __getitem__(self, name: str) -> Row:
        if name not in self._rows:
            self._rows[name] = self._worked_out(name)
        return self._rows[name]

    def _worked_out(self, name: str) -> Row:
        state = self._rows[STATE]
        if name == TOOL_POSE:
            return tool_pose(self._profile, state)
        if name == GRIPPER:
            width = self._profile.gripper.opening(state[self._profile.arm_size :].astype(np.float64))
            return np.array([width, self._command], dtype=np.float32)
        raise KeyError(name)

    def __iter__(self) -> Iterator[str]:
        return iter((STATE, VELOCITY, TOOL_POSE, GRIPPER))

    def __len__(self) -> int:
        return 4

    def __reduce__(self) -> tuple[type[dict[str, Row]], tuple[dict[str, Row]]]:
        return dict, (dict(self),)


def tool_pose(profile: RobotProfile, positions: npt.NDArray[np.float32]) -> Row:
    """(7,) of the tool link in the base frame: x, y, z, qw, qx, qy, qz, with qw at least 0.

    Args:
        positions: (n,) all active joints, rad and m; or (N, n), which gives (N, 7), the same numbers at a small part of
            the cost.
    """
    from scipy.spatial.transform import Rotation  # here: who refuses an argument needs it not

    T_base_tool = profile.model.forward_kinematics(positions.astype(np.float64), profile.tool_link)
    rotation = Rotation.from_matrix(T_base_tool[..., :3, :3], assume_valid=True)
    quaternion = rotation.as_quat(canonical=True, scalar_first=True)
    return np.concatenate([T_base_tool[..., :3, 3], quaternion], axis=-1).astype(np.float32)

"""What a robot knows of itself, from its joints: one function for simulators, recordings and robots."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gensim2.observations.columns import GRIPPER, STATE, TOOL_POSE, VELOCITY
from gensim2.robots import RobotProfile

Row = npt.NDArray[np.float32]


def proprioception(
    profile: RobotProfile, positions: npt.ArrayLike, velocities: npt.ArrayLike, command: float
) -> dict[str, Row]:
    """``state``, ``velocity``, ``tool_pose`` and ``gripper`` of one instant (:mod:`gensim2.observations.columns`).

    Args:
        positions, velocities: (n,) of all active joints, rad and m.
        command: the gripper's last, -1 to 1.
    """
    state = np.array(positions, dtype=np.float32)
    width = profile.gripper.opening(state[profile.arm_size :].astype(np.float64))
    return {
        STATE: state,
        VELOCITY: np.array(velocities, dtype=np.float32),
        TOOL_POSE: tool_pose(profile, state),
        GRIPPER: np.array([width, command], dtype=np.float32),
    }


def tool_pose(profile: RobotProfile, positions: npt.NDArray[np.float32]) -> Row:
    """(7,) of the tool link in the base frame: x, y, z, qw, qx, qy, qz, with qw at least 0.

    Args:
        positions: (n,) all active joints, rad and m.
    """
    from scipy.spatial.transform import Rotation  # here: who refuses an argument needs it not

    T_base_tool = profile.model.forward_kinematics(positions.astype(np.float64), profile.tool_link)
    quaternion = Rotation.from_matrix(T_base_tool[:3, :3]).as_quat(canonical=True, scalar_first=True)
    return np.concatenate([T_base_tool[:3, 3], quaternion]).astype(np.float32)

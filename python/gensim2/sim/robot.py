"""The Panda as it stands in every scene: numbers only, so that they can be read without ManiSkill."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

BASE_POSITION: tuple[float, float, float] = (-0.615, 0.0, 0.0)
"""Robot base in the world, metres; no rotation."""

RESET_QPOS: tuple[float, ...] = (0.0, -0.32, 0.0, -2.61799, 0.0, 2.23, 0.785398, 0.04, 0.04)
"""(9,) joint positions at reset: 7 arm joints (rad), 2 fingers (m)."""

GRIPPER_OPEN, GRIPPER_CLOSED = 1.0, -1.0
"""Values of an action's last entry, mapped to finger targets of 0.04 m and -0.01 m (which presses)."""


def base_pose() -> Array:
    """T_world_base, (4, 4)."""
    pose = np.eye(4)
    pose[:3, 3] = BASE_POSITION
    return pose

"""Names of what an observation holds: the keys of observations, and the columns of exported frames."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

STATE, VELOCITY, TOOL_POSE, GRIPPER = "state", "velocity", "tool_pose", "gripper"
"""(n,) joint positions, rad and m; (n,) their velocities; (7,) tool in the base frame; (2,) pad distance, m, and the
last command, -1 to 1. All float32."""

PROPRIOCEPTION = (STATE, VELOCITY, TOOL_POSE, GRIPPER)

CLOUD, CLOUD_SEGMENTATION = "point_cloud", "point_segmentation"
"""(N, 6) float32: x, y, z in the base frame, m, then red, green, blue from 0 to 1; (N,) int16 ids."""

ENVIRONMENT_STATE = "environment_state"
"""(3 N,) float32 in exports, where clouds are made of keypoints: x, y, z of each in the base frame, m."""

IMAGE, DEPTH, SEGMENTATION = "image_", "depth_", "segmentation_"
"""Before a camera's name: (H, W, 3) uint8; (H, W) uint16, mm, 0 where nothing is seen; (H, W) int16 ids."""


def cloud_column(xyz: npt.NDArray[Any], rgb: npt.NDArray[np.uint8] | None) -> npt.NDArray[np.float32]:
    """(..., N, 6) float32 coordinates in m and colours from 0 to 1; (..., N, 3) where there are no colours."""
    points = xyz.astype(np.float32)
    return points if rgb is None else np.concatenate([points, rgb.astype(np.float32) / 255], axis=-1)


def depth_column(depth: npt.NDArray[np.float32]) -> npt.NDArray[np.uint16]:
    """Depth (m) in whole millimetres."""
    found: npt.NDArray[np.uint16] = np.rint(1000.0 * depth).astype(np.uint16)
    return found

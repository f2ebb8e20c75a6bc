"""Fitted parameters: a camera's pose, and scale and bias of its depth; and the weights of what may be wrong."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from gensim2.perception import Camera

Array = npt.NDArray[np.float64]

FOCAL_BASELINE, DISPARITY_SIGMA = 21.25, 0.08
"""px m and px: a stereo pair's expected error of depth, z^2 sigma / (f B)."""


@dataclass
class Pose:
    """Fitted pose."""

    T: Array
    scale: float = 1.0
    bias: float = 0.0

    def moved(self, step: Array, center: Array) -> Pose:
        """By (8,): a turn about ``center`` (rad), a shift (m), scale and bias."""
        turn = Rotation.from_rotvec(step[:3]).as_matrix()
        T = self.T.copy()
        T[:3, :3] = turn @ T[:3, :3]
        T[:3, 3] = turn @ (T[:3, 3] - center) + center + step[3:6]
        return Pose(T, self.scale + step[6], self.bias + step[7])


def expected_error(depth: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Expected error of a depth, m."""
    return depth**2 * (DISPARITY_SIGMA / FOCAL_BASELINE)


def placed_at(camera: Camera, pose: Pose) -> Camera:
    return replace(camera, T_base_camera=pose.T)


def tukey(residual: Array, scale: float) -> Array:
    """Weights of Tukey's biweight, zero from 4.685 scales on."""
    share = np.clip(residual / (4.685 * scale), -1.0, 1.0)
    return np.asarray((1.0 - share**2) ** 2)

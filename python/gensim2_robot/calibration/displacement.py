"""Camera poses off by a known amount, and by how much a pose is off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from gensim2.perception import Camera


def displaced(camera: Camera, degrees: float, metres: float, draw: np.random.Generator) -> Camera:
    """Return a camera turned by ``degrees`` about a random axis and shifted by ``metres`` in a random direction."""
    axis, way = draw.normal(size=(2, 3))
    T = camera.T_base_camera.copy()
    turn = Rotation.from_rotvec(np.deg2rad(degrees) * axis / np.linalg.norm(axis)).as_matrix()
    T[:3, :3] = turn @ T[:3, :3]
    T[:3, 3] += metres * way / np.linalg.norm(way)
    return replace(camera, T_base_camera=T)


def pose_error(T: npt.NDArray[np.float64], true: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Return distance (mm) and angle (degrees) between two poses (4, 4)."""
    error = np.linalg.inv(true) @ T
    return 1e3 * float(np.linalg.norm(error[:3, 3])), float(np.rad2deg(Rotation.from_matrix(error[:3, :3]).magnitude()))

"""A pinhole camera: where it stands and what its pixels look along."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import InputError, brief

Array = npt.NDArray[np.float64]

MAX_SIDE = 8192
"""Largest width and height of a picture, pixels."""
MAX_DISTANCE = 100.0
"""Largest distance of a camera from the origin of its frame, m."""
MIN_FOCAL, MAX_INTRINSIC = 0.1, 1e6
"""Smallest focal length and largest magnitude of an intrinsic parameter, pixels."""


def pinhole(width: int, height: int, fov: float) -> Array:
    """(3, 3) intrinsic matrix in pixels, the axis through the picture's middle, for a field of view (rad) in height."""
    focal = 0.5 * height / np.tan(0.5 * fov)
    return np.array([[focal, 0.0, 0.5 * width], [0.0, focal, 0.5 * height], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera as OpenCV has it: x to the right of the picture, y down, z forward.

    Attributes:
        name: unique among those of a robot.
        width, height: pixels; the middle of the first one is at (0.5, 0.5).
        intrinsic: (3, 3) in pixels.
        T_base_camera: (4, 4) camera in the robot's base frame.
        far: metres ahead beyond which nothing is seen.
        link: of the robot, that carries it; None: it stands still.
        depth_scale, depth_bias: true depth is the measured one times the first, plus the second (m): calibration.

    Raises:
        InputError: a value has the wrong shape or is out of range; names the attribute.
    """

    name: str
    width: int
    height: int
    intrinsic: Array
    T_base_camera: Array
    far: float = 10.0
    link: str | None = None
    depth_scale: float = 1.0
    depth_bias: float = 0.0

    def __post_init__(self) -> None:
        if not (1 <= self.width <= MAX_SIDE and 1 <= self.height <= MAX_SIDE):
            said = f"must be 1 to {MAX_SIDE} pixels each, are {brief(self.width)} and {brief(self.height)}"
            raise self._refusal(said, "width, height")
        K, T = self.intrinsic, self.T_base_camera
        focal = (np.diagonal(K)[:2] >= MIN_FOCAL).all() if K.shape == (3, 3) else False
        if not focal or not (np.abs(K) <= MAX_INTRINSIC).all() or K[1, 0] != 0.0 or (K[2] != [0.0, 0.0, 1.0]).any():
            said = f"must be [[fx, s, cx], [0, fy, cy], [0, 0, 1]] in pixels, none over {MAX_INTRINSIC:g}"
            raise self._refusal(f"{said}, fx and fy at least {MIN_FOCAL}", "intrinsic")
        if T.shape != (4, 4) or not np.isfinite(T).all() or np.abs(T[3] - [0.0, 0.0, 0.0, 1.0]).max() > 1e-9:
            raise self._refusal("must be a (4, 4) pose whose last row is 0, 0, 0, 1", "T_base_camera")
        turn = T[:3, :3]
        if np.abs(turn @ turn.T - np.eye(3)).max() > 1e-6 or np.linalg.det(turn) < 0.0:
            raise self._refusal("must turn without scaling or mirroring", "T_base_camera")
        if np.abs(T[:3, 3]).max() > MAX_DISTANCE:
            raise self._refusal(f"must lie within {MAX_DISTANCE:g} m of the origin of its frame", "T_base_camera")
        if not (0.0 < self.far < np.inf and 0.0 < self.depth_scale < np.inf and np.isfinite(self.depth_bias)):
            raise self._refusal("must be finite, the first two positive", "far, depth_scale, depth_bias")

    def _refusal(self, said: str, attribute: str) -> InputError:
        return InputError(said, field=f"camera {self.name}: {attribute}")

    @staticmethod
    def looking(name: str, eye: npt.ArrayLike, target: npt.ArrayLike, *, width: int, height: int, fov: float) -> Camera:
        """A camera at ``eye`` that looks at ``target``, both (3,) m in the base frame, upright.

        Args:
            fov: of the picture's height, rad.
        """
        place = np.asarray(eye, dtype=np.float64)
        forward = np.asarray(target, dtype=np.float64) - place
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3, :3] = np.column_stack([right, np.cross(forward, right), forward])
        pose[:3, 3] = place
        return Camera(name, width, height, pinhole(width, height, fov), pose)

    def metres(self, depth: npt.NDArray[np.uint16]) -> npt.NDArray[np.float32]:
        """(H, W) m of (H, W) mm as this camera measures them; 0 stays 0."""
        found = depth.astype(np.float32) * np.float32(1e-3)
        if self.depth_scale == 1.0 and self.depth_bias == 0.0:
            return found
        return np.where(depth > 0, np.float32(self.depth_scale) * found + np.float32(self.depth_bias), np.float32(0.0))

    @cached_property
    def rays(self) -> npt.NDArray[np.float32]:
        """(H, W, 3) rays through the pixel centres in the base frame, at unit depth: a point is the camera's position
        plus its depth (m) times its ray."""
        columns, rows = np.meshgrid(np.arange(self.width) + 0.5, np.arange(self.height) + 0.5)
        pixels = np.stack([columns, rows, np.ones_like(columns)], axis=-1)
        turn = self.T_base_camera[:3, :3] @ np.linalg.inv(self.intrinsic)
        return np.ascontiguousarray(pixels @ turn.T, dtype=np.float32)

    @cached_property
    def position(self) -> npt.NDArray[np.float32]:
        """(3,) m in the base frame."""
        return self.T_base_camera[:3, 3].astype(np.float32)

    @cached_property
    def projection(self) -> Array:
        """(3, 4) from the base frame (homogeneous, m) to pixels times depth."""
        return np.asarray(self.intrinsic @ np.linalg.inv(self.T_base_camera)[:3])

"""Describe cameras and their images."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array
from gensim2.core.errors import InputError, brief
from gensim2.robots import MountedCamera, RobotProfile

MAX_SIDE = 8192
"""Maximum width and height of an image, pixels."""
MAX_DISTANCE = 100.0
"""Maximum distance of a camera from the origin of its frame, m."""
MIN_FOCAL, MAX_INTRINSIC = 0.1, 1e6
"""Minimum focal length and maximum magnitude of an intrinsic parameter, pixels."""


def pinhole(width: int, height: int, fov: float) -> Array:
    """Return the intrinsic matrix (3, 3) of a pinhole camera whose optical axis meets the image centre.

    Args:
        width, height: image size, pixels.
        fov: vertical field of view, rad.
    """
    focal = 0.5 * height / np.tan(0.5 * fov)
    return np.array([[focal, 0.0, 0.5 * width], [0.0, focal, 0.5 * height], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera in OpenCV's convention: x to the right of the image, y down, z forward.

    Attributes:
        name: unique name among the robot's cameras.
        width, height: image size, pixels; the centre of the first pixel is at (0.5, 0.5).
        intrinsic: (3, 3) intrinsic matrix, pixels.
        T_base_camera: (4, 4) pose of the camera in the robot's base frame.
        far: maximum depth, m.
        link: link of the robot that carries the camera; None for a fixed camera.
        depth_scale, depth_bias: calibration: true depth = ``depth_scale`` * measured depth + ``depth_bias`` (m).

    Raises:
        InputError: a value has the wrong shape or is out of range; the message names the attribute.
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
        small = np.abs(turn).max() <= 2.0  # larger entries could overflow in the product below
        if not small or np.abs(turn @ turn.T - np.eye(3)).max() > 1e-6 or np.linalg.det(turn) < 0.0:
            raise self._refusal("must be a rotation without scaling or mirroring", "T_base_camera")
        if np.abs(T[:3, 3]).max() > MAX_DISTANCE:
            raise self._refusal(f"must be at most {MAX_DISTANCE:g} m from the origin of its frame", "T_base_camera")
        if not (0.0 < self.far < np.inf and 0.0 < self.depth_scale < np.inf and np.isfinite(self.depth_bias)):
            raise self._refusal("must be finite, and the first two must be positive", "far, depth_scale, depth_bias")

    def _refusal(self, said: str, attribute: str) -> InputError:
        return InputError(said, field=f"camera {self.name}: {attribute}")

    @staticmethod
    def looking(name: str, eye: npt.ArrayLike, target: npt.ArrayLike, *, width: int, height: int, fov: float) -> Camera:
        """Return an upright camera at ``eye`` that looks at ``target``, both (3,) m in the base frame.

        Args:
            fov: vertical field of view, rad.
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
        """Convert measured depth (H, W) in mm to calibrated depth in m; 0 stays 0."""
        found = depth.astype(np.float32) * np.float32(1e-3)
        if self.depth_scale == 1.0 and self.depth_bias == 0.0:
            return found
        return np.where(depth > 0, np.float32(self.depth_scale) * found + np.float32(self.depth_bias), np.float32(0.0))

    @cached_property
    def rays(self) -> npt.NDArray[np.float32]:
        """Rays (H, W, 3) through the pixel centres in the base frame, scaled to unit depth.

        The point seen by a pixel is the camera's position plus the pixel's depth (m) times the pixel's ray.
        """
        columns, rows = np.meshgrid(np.arange(self.width) + 0.5, np.arange(self.height) + 0.5)
        pixels = np.stack([columns, rows, np.ones_like(columns)], axis=-1)
        turn = self.T_base_camera[:3, :3] @ np.linalg.inv(self.intrinsic)
        return np.ascontiguousarray(pixels @ turn.T, dtype=np.float32)

    @cached_property
    def position(self) -> npt.NDArray[np.float32]:
        """Position (3,) in the base frame, m."""
        return self.T_base_camera[:3, 3].astype(np.float32)

    @cached_property
    def projection(self) -> Array:
        """Projection matrix (3, 4). It maps a homogeneous point in the base frame (m) to pixel coordinates multiplied
        by the depth.
        """
        return np.asarray(self.intrinsic @ np.linalg.inv(self.T_base_camera)[:3])


TARGET = (-0.1, 0.0, 0.15)
"""Point that the fixed cameras look at, the centre of the workspace, m in the world frame."""

PLACES = {"left": (-0.3, 0.75, 0.65), "right": (-0.3, -0.75, 0.65), "front": (0.75, 0.0, 0.65)}
"""Positions of the fixed cameras, m in the world frame: on the left, on the right, and on the far side of the table."""

PIXELS = 128
"""Width and height of an image of a fixed camera, pixels."""

FIELD_OF_VIEW = float(np.deg2rad(60))
"""Vertical field of view of the fixed cameras, rad."""

NEAR, FAR = 0.01, 10.0
"""Minimum and maximum depth that the cameras measure, m."""


def observation_cameras(profile: RobotProfile) -> tuple[Camera, ...]:
    """Return the fixed cameras, which stand beside the robot. Their poses are in the robot's base frame."""
    base, turn = np.array(profile.base_position), profile.T_world_base[:3, :3].T
    return tuple(
        Camera.looking(
            name, turn @ (place - base), turn @ (TARGET - base), width=PIXELS, height=PIXELS, fov=FIELD_OF_VIEW
        )
        for name, place in PLACES.items()
    )


def mounted(camera: MountedCamera, T_base_link: npt.NDArray[np.float64]) -> Camera:
    """Return a robot-mounted camera with its pose in the base frame. ``T_base_link`` (4, 4) is the pose of the link
    that carries the camera, also in the base frame.
    """
    pose = T_base_link @ np.asarray(camera.T_link_camera, dtype=np.float64)
    intrinsic = pinhole(camera.width, camera.height, camera.field_of_view)
    return Camera(camera.name, camera.width, camera.height, intrinsic, pose, FAR, camera.link)


def require_cameras(names: tuple[str, ...], profile: RobotProfile) -> None:
    """Check that each name belongs to exactly one camera.

    Raises:
        InputError: no camera has the name, or both a fixed camera and a camera of the robot have the name.
    """
    own = [camera.name for camera in profile.cameras]
    for name in own:
        if name in PLACES:
            raise InputError(
                f"the robot has a camera {name!r}, but this name is reserved for a fixed camera",
                field=f"{profile.name}.cameras",
                remedy="rename the robot's camera",
            )
    for name in names:
        if name not in PLACES and name not in own:
            known = ", ".join([*PLACES, *own])
            raise InputError(f"{profile.name} has no camera {name!r}", field="cameras", remedy=f"choose from {known}")


class View(Protocol):
    @property
    def camera(self) -> Camera: ...

    @property
    def depth(self) -> npt.NDArray[np.float32]:
        """Depth (H, W), m; 0 for pixels without a measurement."""
        ...

    @property
    def segmentation(self) -> npt.NDArray[np.int16] | None:
        """Segmentation ids (H, W), 0 for background; None if unknown."""
        ...

    def colors_at(self, pixels: npt.NDArray[np.int64]) -> npt.NDArray[np.uint8]:
        """Return the colours (k, 3) of pixels, given by their row-major index."""
        ...


@dataclass(frozen=True, eq=False)
class Picture:
    """A depth image with its camera, taken by a real camera or simulated with noise. Colours and segmentation ids are
    optional. The class implements the interface :class:`View`.
    """

    camera: Camera
    depth: npt.NDArray[np.float32]
    segmentation: npt.NDArray[np.int16] | None = None
    colors: npt.NDArray[np.uint8] | None = None

    def colors_at(self, pixels: npt.NDArray[np.int64]) -> npt.NDArray[np.uint8]:
        """Return the colours (k, 3) of pixels; black if the image has no colours."""
        if self.colors is None:
            return np.zeros((len(pixels), 3), dtype=np.uint8)
        return self.colors.reshape(-1, 3)[pixels]

"""The cameras of observations, as numbers, for SAPIEN's renderer and for ray casting: three fixed, and the robot's."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import InputError
from gensim2.perception.camera import Camera, pinhole
from gensim2.robots import MountedCamera, RobotProfile

TARGET = (-0.1, 0.0, 0.15)
"""Point that the cameras look at, m in the world: the middle of the workspace."""

PLACES = {"left": (-0.3, 0.75, 0.65), "right": (-0.3, -0.75, 0.65), "front": (0.75, 0.0, 0.65)}
"""Positions of the cameras, m in the world: to the left, to the right, on the far side."""

PIXELS = 128
"""Width and height of a picture."""

FIELD_OF_VIEW = float(np.deg2rad(60))
"""Rad, of its height."""

NEAR, FAR = 0.01, 10.0
"""Metres ahead between which anything is seen."""


def observation_cameras(profile: RobotProfile) -> tuple[Camera, ...]:
    """The cameras in the robot's base frame."""
    base, turn = np.array(profile.base_position), profile.T_world_base[:3, :3].T
    return tuple(
        Camera.looking(
            name, turn @ (place - base), turn @ (TARGET - base), width=PIXELS, height=PIXELS, fov=FIELD_OF_VIEW
        )
        for name, place in PLACES.items()
    )


def mounted(camera: MountedCamera, T_base_link: npt.NDArray[np.float64]) -> Camera:
    """A camera that a link carries, where that link stands at ``T_base_link`` (4, 4)."""
    pose = T_base_link @ np.asarray(camera.T_link_camera, dtype=np.float64)
    intrinsic = pinhole(camera.width, camera.height, camera.field_of_view)
    return Camera(camera.name, camera.width, camera.height, intrinsic, pose, FAR, camera.link)


def require_cameras(names: tuple[str, ...], profile: RobotProfile) -> None:
    """Refuse names of cameras that there are not.

    Raises:
        InputError: neither a fixed camera nor one of the robot's is called so, or one of each.
    """
    own = [camera.name for camera in profile.cameras]
    for name in own:
        if name in PLACES:
            raise InputError(f"{name!r} is a fixed camera", field=f"{profile.name}.cameras", remedy="rename it")
    for name in names:
        if name not in PLACES and name not in own:
            known = ", ".join([*PLACES, *own])
            raise InputError(f"{profile.name} has no camera {name!r}", field="cameras", remedy=f"some of {known}")

"""The three cameras of observations, as numbers: for SAPIEN's renderer and for ray casting."""

from __future__ import annotations

import numpy as np

from gensim2.observations.camera import Camera
from gensim2.robots import RobotProfile

TARGET = (-0.1, 0.0, 0.15)
"""What they look at, m in the world: the middle of the workspace."""

PLACES = {"left": (-0.3, 0.75, 0.65), "right": (-0.3, -0.75, 0.65), "front": (0.75, 0.0, 0.65)}
"""Where they stand, m in the world: to the left, to the right, on the far side."""

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

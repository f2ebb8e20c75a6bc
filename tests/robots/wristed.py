"""The Panda with a camera on its hand that looks between its fingers."""

from __future__ import annotations

from dataclasses import replace
from math import cos, sin

import numpy as np

import gensim2
from gensim2.robots import MountedCamera, RobotProfile

TILT = 0.3
"""Tilt of the camera towards the fingers, rad."""

T_HAND_CAMERA = np.array(
    [
        [0.0, -cos(TILT), -sin(TILT), 0.07],
        [1.0, 0.0, 0.0, 0.0],
        [0.0, -sin(TILT), cos(TILT), 0.02],
        [0.0, 0.0, 0.0, 1.0],
    ]
)


@gensim2.register_robot
def wristed_panda() -> RobotProfile:
    panda = gensim2.robot("panda")
    return replace(
        panda,
        name="wristed_panda",
        cameras=(MountedCamera("wrist", "panda_hand", T_HAND_CAMERA, 96, 64, 1.1),),
        simulation=replace(panda.simulation, agent="wristed_panda"),
    )

"""The Panda on a base turned about the vertical, with the first joint turned back: the same arm in the world."""

from __future__ import annotations

from dataclasses import replace
from math import cos, sin

import gensim2
from gensim2.robots import RobotProfile

TURN = 0.9
"""Angle of the base, rad."""


@gensim2.register_robot
def turned_panda() -> RobotProfile:
    panda = gensim2.robot("panda")
    return replace(
        panda,
        name="turned_panda",
        base_quaternion=(cos(TURN / 2), 0.0, 0.0, sin(TURN / 2)),
        reset_qpos=(panda.reset_qpos[0] - TURN, *panda.reset_qpos[1:]),
        simulation=replace(panda.simulation, agent="turned_panda"),
    )

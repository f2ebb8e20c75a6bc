"""Define desk staplers. Some are pushed, and the arms of others are pressed down.

The front of a stapler faces +z.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gensim2.core.arrays import Array
from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import Solid, box, convex, rod, rounded_box


@dataclass(frozen=True)
class Stapler:
    """Parts of a stapler whose arm is level.

    Points (3,) of a stapler. ``hinge`` is on the axis of the arm, and ``tip`` on the upper side of the arm's front end.
    """

    base: list[Solid]
    arm: list[Solid]
    hinge: Array
    tip: Array


def draw(rng: np.random.Generator) -> Stapler:
    """Generate a random stapler with its arm level (joint value zero)."""
    length, width = c.between(rng, 0.13, 0.18), c.between(rng, 0.030, 0.042)
    thick = c.between(rng, 0.014, 0.020)
    look = c.pick(rng, c.PAINTS)
    metal = c.pick(rng, (c.STEEL, c.CHROME))
    slope = c.between(rng, 0.55, 0.9)

    back, front = -length / 2, length / 2
    foot = 0.008
    gap = 0.032
    bottom = -0.5 * (foot + gap + thick)
    base = [
        rounded_box((0, bottom + foot / 2, 0), (width, foot, length), c.BLACK, 0.010),
        box((0, bottom + foot + 0.0005, front - 0.02), (0.5 * width, 0.002, 0.016), metal, 0.0).visual_only(),
        box((0, bottom + foot + gap / 2, back + 0.012), (0.7 * width, gap - 0.004, 0.020), look),
    ]
    y = bottom + foot + gap
    hinge = np.array([0.0, y - 0.002, back + 0.010])
    profile = [
        (sx * k * width / 2, h, z)
        for sx in (-1, 1)
        for k, h, z in (
            (0.9, y, back),
            (0.9, y, front),
            (1.0, y + slope * thick, front - 0.004),
            (1.0, y + thick, front - 0.45 * length),
            (1.0, y + 0.8 * thick, back),
        )
    ]
    arm = [convex(profile, look)]
    arm.append(box((0, y - 0.003, 0.1 * length), (0.6 * width, 0.006, 0.76 * length), metal, 0.0).visual_only())
    arm.append(
        rod((-0.52 * width, hinge[1] + 0.004, hinge[2]), (0.52 * width, hinge[1] + 0.004, hinge[2]), 0.005, metal)
    )
    tip = np.array([0, y + slope * thick, front - 0.004])
    return Stapler(base, arm, hinge, tip)


def move(rng: np.random.Generator) -> Blueprint:
    stapler = draw(rng)
    return c.pushed(stapler.base + stapler.arm, 0.2, "the tip of the stapler", stapler.tip)


MOVE = ObjectClass("stapler_move", 3, "prismatic", move)


def press(rng: np.random.Generator) -> Blueprint:
    stapler = draw(rng)
    return c.hinged(
        stapler.base,
        stapler.arm,
        stapler.hinge,
        (-1, 0, 0),
        (-0.12, 0.3),
        head=(stapler.tip, "the tip of the stapler's arm"),
    )


PRESS = ObjectClass("stapler_press", 3, "revolute", press)

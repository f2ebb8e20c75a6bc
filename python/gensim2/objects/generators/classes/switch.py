"""Define a class of generated objects: a big rocker switch on a stand."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import box, convex, rod, rounded_box


def build(rng: np.random.Generator) -> Blueprint:
    width, height = c.between(rng, 0.09, 0.12), c.between(rng, 0.12, 0.15)
    rocker_w, rocker_h = c.between(rng, 0.045, 0.060), c.between(rng, 0.075, 0.095)
    look = c.pick(rng, (c.WHITE, *c.PAINTS[:3], c.BRASS))
    stand_look = c.pick(rng, (*c.WOODS, c.DARK_METAL))
    rise = c.between(rng, 0.10, 0.16)
    tilt = c.between(rng, 0.20, 0.28)

    plate = 0.012
    body = [rounded_box((0, 0, 0), (width, height, plate), look, 0.012, axis=2)]
    body.append(box((0, -height / 2 - rise / 2, -0.016), (0.6 * width, rise + height, 0.020), stand_look))
    foot_y = -height / 2 - rise - height / 2
    body.append(box((0, foot_y - 0.008, -0.01), (width + 0.04, 0.016, 0.13), stand_look))
    for s in (-1, 1):
        screw = np.array([0, s * 0.42 * height, plate / 2])
        body.append(rod(screw, screw + np.array([0, 0, 0.0015]), 0.004, c.CHROME).visual_only())
    # The pin is so far in front of the plate that the ends of the rocker do not touch the plate.
    clear = rocker_h / 2 * np.sin(tilt) + 0.004
    z = plate / 2 + clear
    thick = 0.010
    profile = [
        (sx * rocker_w / 2, y, z + dz)
        for sx in (-1, 1)
        for y, dz in ((-rocker_h / 2, 0.0), (rocker_h / 2, 0.0), (rocker_h / 2, thick), (-rocker_h / 2, thick))
    ]
    moving = [convex(profile, c.WHITE if look is not c.WHITE else c.PAINTS[0])]
    moving.append(
        rod(
            (-rocker_w / 2, 0, z - 0.3 * clear), (rocker_w / 2, 0, z - 0.3 * clear), 0.5 * clear, c.DARK_METAL
        ).visual_only()
    )
    mark = box((0, 0.3 * rocker_h, z + thick), (0.003, 0.014, 0.001), c.PAINTS[1], 0.0)
    moving.append(mark.visual_only())
    moving.append(c.hoop((0, -0.3 * rocker_h, z + thick), (0, 0, 1), 0.006, 0.001, c.PAINTS[1]))
    return c.hinged(
        body,
        moving,
        (0, 0, z),
        (-1, 0, 0),
        (-tilt, tilt),
        head=((0, 0.42 * rocker_h, z + thick), "the upper end of the rocker, pressed to turn the light on"),
        tail=((0, -0.42 * rocker_h, z + thick), "the lower end of the rocker, pressed to turn the light off"),
    )


OBJECT_CLASS = ObjectClass("switch", 2, "revolute", build)

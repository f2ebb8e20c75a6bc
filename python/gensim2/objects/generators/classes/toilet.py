"""Define a class of generated objects: a toilet with a hinged lid."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import Look, box, cone, convex, rod, rounded_box, tube, turned_profile

GAP = 0.0015
WATER = Look((0.45, 0.65, 0.75, 0.8), 0.0, 0.05)


def build(rng: np.random.Generator) -> Blueprint:
    radius = c.between(rng, 0.075, 0.092)
    rim = c.between(rng, 0.13, 0.16)
    tank_h, tank_w = c.between(rng, 0.12, 0.16), c.between(rng, 0.17, 0.21)
    lid = c.between(rng, 0.008, 0.011)
    look = c.pick(rng, (c.WHITE, c.PAINTS[0]))
    lid_look = look if rng.random() < 0.6 else c.pick(rng, c.WOODS)
    metal = c.CHROME
    overhang = c.between(rng, 0.008, 0.014)

    bottom = -0.5 * rim
    top = bottom + rim
    bowl_z = 0.02
    back = bowl_z - radius - 0.012
    body = [
        cone((0, bottom, bowl_z - 0.015), (0, bottom + 0.45 * rim, bowl_z - 0.01), 0.62 * radius, 0.55 * radius, look)
    ]
    body += tube(
        (0, bottom + 0.45 * rim, bowl_z), (0, top, bowl_z), 0.6 * radius, radius, 0.014, look, 12, bottom=0.008
    )
    seat = [(radius - 0.001, 0.0), (radius - 0.003, 1.0), (radius - 0.020, 1.0), (radius - 0.022, 0.0)]
    body.append(turned_profile((0, top - 0.004, bowl_z), (0, top + 0.0008, bowl_z), seat, lid_look))
    water = np.array([0, bottom + 0.45 * rim + 0.02, bowl_z])
    body.append(rod(water, water + np.array([0, 0.001, 0]), 0.58 * radius, WATER, 16).visual_only())
    body.append(box((0, bottom + 0.4 * rim, back - 0.02), (1.1 * radius, 0.8 * rim, 0.06), look, 0.004))
    tank_z = back - 0.045
    body.append(rounded_box((0, top + tank_h / 2 - 0.01, tank_z), (tank_w, tank_h + 0.02, 0.07), look, 0.015))
    cover = (0, top + tank_h + 0.004, tank_z)
    body.append(rounded_box(cover, (tank_w + 0.012, 0.012, 0.078), look, 0.015))
    body.append(rod((0, cover[1] + 0.006, tank_z), (0, cover[1] + 0.010, tank_z), 0.013, metal).visual_only())
    y = top + GAP
    reach = bowl_z + radius + overhang
    outline = [
        (x, h, z)
        for h in (y, y + lid)
        for x, z in [
            (-0.75 * radius, back),
            (0.75 * radius, back),
            *[
                (1.02 * radius * np.cos(t), bowl_z + (radius + overhang) * np.sin(t))
                for t in np.linspace(-0.2, np.pi + 0.2, 13)
            ],
        ]
    ]
    shape = [convex(outline, lid_look)]
    for s in (-1, 1):
        pin = np.array([s * 0.5 * radius, y + 0.002, back])
        body.append(rod(pin - np.array([0.012, 0, 0]), pin + np.array([0.012, 0, 0]), 0.005, metal).visual_only())
    return c.hinged(
        body,
        shape,
        (0, y, back),
        (-1, 0, 0),
        (0.0, 1.45),
        head=((0, y + lid / 2, reach), "the midpoint of the front edge of the toilet's lid"),
    )


OBJECT_CLASS = ObjectClass("toilet", 2, "revolute", build)

"""Define a class of generated objects: a trash can with a hinged lid."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import box, cone, rod, tray, tube

GAP = 0.0015


def build(rng: np.random.Generator) -> Blueprint:
    width = c.between(rng, 0.15, 0.20)
    height = c.between(rng, 0.20, 0.26)
    lid = c.between(rng, 0.010, 0.016)
    overhang = c.between(rng, 0.010, 0.016)
    is_round = rng.random() < 0.5
    look = c.pick(rng, (*c.PAINTS, c.STEEL))
    lid_look = look if rng.random() < 0.4 else c.pick(rng, (*c.PAINTS, c.BLACK))
    pedal = rng.random() < 0.6

    bottom, top = -height / 2, height / 2
    if is_round:
        radius = width / 2
        deep = width
        body = tube((0, bottom, 0), (0, top, 0), 0.92 * radius, radius, 0.006, look, 12, bottom=0.008)
    else:
        deep = c.between(rng, 0.14, 0.18)
        body = tray((0, 0, 0), (width, height, deep), 0.007, look, "+y")
    front, back = deep / 2, -deep / 2
    y = top + GAP
    if is_round:
        shape = [cone((0, y, 0), (0, y + lid, 0), radius + 0.002, 0.9 * radius, lid_look)]
        shape.append(box((0, y + 0.005, front + overhang / 2 - 0.004), (0.06, 0.010, overhang + 0.012), lid_look))
    else:
        depth = deep + overhang
        shape = [box((0, y + lid / 2, back + depth / 2), (width, lid, depth), lid_look, 0.004)]
    body.append(
        rod((-0.03, top - 0.006, back - 0.004), (0.03, top - 0.006, back - 0.004), 0.004, c.STEEL).visual_only()
    )
    if is_round:
        body.append(c.hoop((0, bottom + 0.005, 0), (0, 1, 0), 0.92 * width / 2, 0.005, c.BLACK))
        body.append(c.hoop((0, top - 0.003, 0), (0, 1, 0), width / 2, 0.0022, look))
    else:
        for k in range(3):
            for s in (-1, 1):
                rib = (s * width / 2, 0, (k - 1) * 0.25 * deep)
                body.append(box(rib, (0.003, 0.86 * height, 0.012), look).visual_only())
    if pedal:
        body.append(box((0, bottom + 0.012, front), (0.07, 0.016, 0.008), c.DARK_METAL).visual_only())
        body.append(box((0, bottom + 0.012, front + 0.012), (0.05, 0.008, 0.03), c.BLACK).visual_only())
    reach = front + overhang
    return c.hinged(
        body,
        shape,
        (0, y, back - 0.002),
        (-1, 0, 0),
        (0.0, 1.5),
        head=((0, y + 0.005, reach), "the midpoint of the front edge of the trash can's lid"),
    )


OBJECT_CLASS = ObjectClass("trash_can", 3, "revolute", build)

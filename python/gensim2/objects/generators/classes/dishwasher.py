"""A dishwasher: a plain door that folds down, racks of dishes behind it."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _appliance as a
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import box, rod


def build(rng: np.random.Generator) -> Blueprint:
    size = a.FoldDown(
        width=c.between(rng, 0.26, 0.32),
        height=c.between(rng, 0.28, 0.33),
        depth=c.between(rng, 0.23, 0.28),
        plinth=c.between(rng, 0.055, 0.070),
        panel=c.between(rng, 0.020, 0.030),
        wall=c.between(rng, 0.008, 0.014),
        door=c.between(rng, 0.018, 0.026),
    )
    look = c.pick(rng, (c.WHITE, c.STEEL, c.PAINTS[5], c.PAINTS[0]))
    metal = c.pick(rng, (c.CHROME, c.STEEL))

    body = a.carcass(size, look)
    low, high = size.opening
    inner = size.width - 2 * size.wall
    for level in (0.18, 0.58):
        y = low + level * (high - low)
        body.append(box((0, y, 0), (inner, 0.003, 0.84 * size.depth), c.STEEL, 0.0).visual_only())
        for k in range(7):
            x = (k - 3) * inner / 8
            at = np.array([x, y + 0.028, 0.0])
            body.append(rod(at, at + np.array([0.003, 0, 0]), 0.030, c.WHITE).visual_only())
    door, hinge, head = a.fold_down_door(size, look, metal, rng, window=False)
    z = size.front + a.GAP + size.door
    door.append(box((0, high - 0.022, z), (0.9 * size.width, 0.024, 0.002), c.BLACK, 0.0).visual_only())
    door.append(box((0.3 * size.width, high - 0.022, z + 0.001), (0.04, 0.010, 0.002), c.DISPLAY, 0.0).visual_only())
    return a.fold_down(body, door, hinge, head, "dishwasher")


OBJECT_CLASS = ObjectClass("dishwasher", 3, "revolute", build)

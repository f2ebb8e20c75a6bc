"""An oven: a door with a window that folds down, knobs above it."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _appliance as a
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import box, rod


def build(rng: np.random.Generator) -> Blueprint:
    size = a.FoldDown(
        width=c.between(rng, 0.28, 0.36),
        height=c.between(rng, 0.28, 0.34),
        depth=c.between(rng, 0.22, 0.27),
        plinth=c.between(rng, 0.060, 0.075),
        panel=c.between(rng, 0.045, 0.060),
        wall=c.between(rng, 0.010, 0.016),
        door=c.between(rng, 0.014, 0.020),
    )
    look = c.pick(rng, (c.WHITE, c.STEEL, c.BLACK, *c.PAINTS[1:4]))
    metal = c.pick(rng, (c.CHROME, c.STEEL))
    knobs = int(rng.integers(3, 6))
    plates = rng.random() < 0.7

    body = a.carcass(size, look)
    y = size.height / 2 - size.panel / 2
    for k in range(knobs):
        at = np.array([((k + 0.5) / knobs - 0.5) * 0.8 * size.width, y, size.front])
        body.append(rod(at, at + np.array([0, 0, 0.014]), 0.012, metal).visual_only())
        body.append(box(at + np.array([0, 0.006, 0.014]), (0.002, 0.010, 0.001), c.BLACK, 0.0).visual_only())
    if plates:
        for sx in (-1, 1):
            for sz, radius in ((-1, 0.038), (1, 0.046)):
                at = np.array([sx * 0.24 * size.width, size.height / 2, sz * 0.24 * size.depth])
                body.append(rod(at, at + np.array([0, 0.002, 0]), radius, c.BLACK).visual_only())
    low, high = size.opening
    for level in (0.35, 0.65):
        rack = (size.width - 2 * size.wall, 0.003, 0.8 * size.depth)
        body.append(box((0, low + level * (high - low), -0.02), rack, c.STEEL, 0.0).visual_only())
    door, hinge, head = a.fold_down_door(size, look, metal, rng, window=True)
    return a.fold_down(body, door, hinge, head, "oven")


OBJECT_CLASS = ObjectClass("oven", 4, "revolute", build)

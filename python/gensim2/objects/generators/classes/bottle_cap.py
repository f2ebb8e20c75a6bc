"""Define a class of generated objects: a bottle with a winged cap that turns."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import Look, box, cone, rod


def build(rng: np.random.Generator) -> Blueprint:
    radius, height = c.between(rng, 0.030, 0.042), c.between(rng, 0.10, 0.15)
    shoulder, neck = c.between(rng, 0.025, 0.045), c.between(rng, 0.02, 0.035)
    throat = radius * c.between(rng, 0.38, 0.50)
    red, green, blue = (c.between(rng, 0.1, 0.6) for _ in range(3))
    glass = Look((red, green, blue, 0.85), 0.0, 0.1)
    label = c.pick(rng, c.PAINTS)
    cap_look = c.pick(rng, (*c.PAINTS, c.BRASS))
    cap = c.between(rng, 0.016, 0.024)
    wing = c.between(rng, 0.024, 0.034)

    total = height + shoulder + neck
    y0 = -total / 2
    y1, y2, y3 = y0 + height, y0 + height + shoulder, y0 + total
    body = [
        cone((0, y0, 0), (0, y1, 0), radius, radius, glass),
        cone((0, y1, 0), (0, y2, 0), radius, throat, glass),
        cone((0, y2, 0), (0, y3, 0), throat, throat, glass),
        rod((0, y0 + 0.25 * height, 0), (0, y0 + 0.75 * height, 0), radius + 0.0006, label, 16).visual_only(),
    ]
    base = y3 + 0.001
    moving = [
        cone((0, base, 0), (0, base + cap, 0), throat + 0.003, throat + 0.002, cap_look),
        # The fingers turn the cap by two wings that stand out to the sides.
        box((0, base + cap / 2, 0), (2 * wing, 0.7 * cap, 0.008), cap_look),
    ]
    for k in range(12):
        angle = k * np.pi / 6
        x, z = (throat + 0.003) * np.cos(angle), (throat + 0.003) * np.sin(angle)
        moving.append(rod((x, base, z), (x, base + 0.9 * cap, z), 0.001, cap_look, 6).visual_only())
    return c.hinged(
        body,
        moving,
        (0, base, 0),
        (0, 1, 0),
        (-np.pi / 2, np.pi / 2),
        head=((wing, base + cap / 2, 0), "the tip of the wing of the bottle's cap"),
        tail=((0, base + cap, 0), "the middle of the bottle's cap"),
    )


OBJECT_CLASS = ObjectClass("bottle_cap", 2, "revolute", build)

"""A bucket with a wire handle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import Array, Solid, arc, ball, path, rod, tube


@dataclass(frozen=True)
class Bucket:
    """Parts of one bucket, handle up; ``hinge`` (3,) is the middle of the axis, ``top`` the highest point."""

    body: list[Solid]
    handle: list[Solid]
    hinge: Array
    top: Array
    front: Array
    height: float


def draw(rng: np.random.Generator) -> Bucket:
    """One bucket."""
    height, wide = c.between(rng, 0.13, 0.19), c.between(rng, 0.075, 0.10)
    narrow = wide * c.between(rng, 0.70, 0.92)
    wall = c.between(rng, 0.004, 0.006)
    look = c.pick(rng, (*c.PAINTS, c.STEEL))
    wire = c.pick(rng, (c.STEEL, c.DARK_METAL))
    grip_look = c.pick(rng, (c.BLACK, *c.WOODS))
    thick = c.between(rng, 0.004, 0.006)
    rings = int(rng.integers(0, 3))

    bottom, top = -height / 2, height / 2
    body = tube((0, bottom, 0), (0, top, 0), narrow, wide, wall, look, 12, bottom=0.006)
    body.append(c.hoop((0, top, 0), (0, 1, 0), wide - wall / 2, 0.7 * wall, look))
    for k in range(rings):
        y = bottom + (k + 1) * height / (rings + 1)
        radius = narrow + (wide - narrow) * (y - bottom) / height
        body.append(c.hoop((0, y, 0), (0, 1, 0), radius, 0.6 * wall, wire))
    # The handle clears the rim all the way down, its grip included.
    half = wide + 0.017
    hinge = np.array([0.0, top - 0.016, 0.0])
    for side in (-1, 1):
        ear = hinge + np.array([side * wide, 0, 0])
        body.append(rod(ear, ear + np.array([side * 0.016, 0, 0]), 0.008, wire).visual_only())
    span = np.pi
    points = arc(hinge, (-1, 0, 0), (0, 1.0, 0), half, 0.0, span, 10)
    handle = path(points, thick, wire, 8)
    crown = hinge + np.array([0, half, 0])
    grip = rod(crown - np.array([0.035, 0, 0]), crown + np.array([0.035, 0, 0]), thick + 0.005, grip_look, 10)
    handle += [
        grip,
        ball(points[0], 1.3 * thick, wire).visual_only(),
        ball(points[-1], 1.3 * thick, wire).visual_only(),
    ]
    return Bucket(body, handle, hinge, crown, np.array([0, top - 0.01, wide]), height)

"""A handbag: a tapered body and a strap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gensim2.assets.classes import _common as c
from gensim2.assets.shapes import Array, Solid, arc, box, convex, path, rod

LEATHERS = c.PAINTS[1:]


@dataclass(frozen=True)
class Bag:
    """Parts of one bag; ``hinge`` (3,) is the middle of the axis, ``top`` the highest point."""

    body: list[Solid]
    strap: list[Solid]
    hinge: Array
    top: Array
    front: Array


def draw(rng: np.random.Generator) -> Bag:
    """One bag, standing upright, the strap pointing up."""
    width, depth, height = c.between(rng, 0.18, 0.26), c.between(rng, 0.07, 0.11), c.between(rng, 0.11, 0.16)
    taper = c.between(rng, 0.55, 0.85)
    look = c.pick(rng, LEATHERS)
    strap_look = c.pick(rng, (*LEATHERS, c.BLACK))
    metal = c.pick(rng, c.METALS)
    thick = c.between(rng, 0.005, 0.007)
    span = c.between(rng, 0.42, 0.62) * width
    rise = c.between(rng, 0.07, 0.11)

    top = height / 2
    corners = [
        (sx * width / 2 * k, y, sz * depth / 2 * k)
        for y, k in ((-top, 1.0), (0.3 * top, 0.97), (top, taper))
        for sx in (-1, 1)
        for sz in (-1, 1)
    ]
    body = [convex(corners, look)]
    flap_z = depth / 2 * 0.93
    body.append(box((0, 0.12 * height, flap_z), (0.34 * width, 0.40 * height, 0.010), strap_look).visual_only())
    body.append(box((0, 0.0, flap_z + 0.007), (0.022, 0.018, 0.006), metal).visual_only())
    for side in (-1, 1):
        x = side * span / 2
        body.append(rod((x, top - 0.002, -0.008), (x, top - 0.002, 0.008), 0.006, metal).visual_only())
    hinge = np.array([0.0, top + 0.010, 0.0])
    points = arc(hinge, (-1, 0, 0), (0, rise / (span / 2), 0), span / 2, 0.0, np.pi, 8)
    strap = path(points, thick, strap_look, 8)
    return Bag(body, strap, hinge, hinge + np.array([0, rise, 0]), np.array([0, 0.2 * height, depth / 2]))

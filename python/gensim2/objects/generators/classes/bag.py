"""Define three classes of generated handbags: lifted bags, pushed bags, and bags whose strap swings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gensim2.core.arrays import Array
from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import Look, Solid, arc, ball, box, convex, loft, path, rod, swept

LEATHERS = c.PAINTS[1:]


@dataclass(frozen=True)
class Bag:
    """Parts of a bag.

    ``hinge`` (3,) is the middle of the axis of the strap, and ``top`` (3,) the highest point of the strap.
    """

    body: list[Solid]
    strap: list[Solid]
    hinge: Array
    top: Array
    front: Array


def _section(width: float, depth: float, y: float) -> Array:
    t = 2 * np.pi * np.arange(40) / 40
    s, k = np.sin(t), np.cos(t)
    x, z = (np.sign(v) * np.abs(v) ** 0.45 for v in (s, k))
    return np.column_stack([0.5 * width * x, np.full(40, y), 0.5 * depth * z])


def _leather(
    width: float, depth: float, height: float, taper: float, look: Look, trim: Look, metal: Look
) -> list[Solid]:
    top = height / 2

    def size(y: float) -> tuple[float, float]:
        share = float(np.interp(y, (-top, 0.3 * top, top), (1.0, 0.97, taper)))
        round_off = 0.006 * max(0.0, 1 - (y + top) / 0.008)
        return share * width - 2 * round_off, share * depth - 2 * round_off

    heights = [-top, -top + 0.003, -top + 0.008, *np.linspace(-0.8 * top, top, 9)]
    parts = [Solid(None, loft([_section(*size(y), y) for y in heights], look))]
    for y, thick in ((-top + 0.006, 0.0016), (top - 0.003, 0.0014)):
        line = _section(*size(y), y)
        parts.append(Solid(None, swept([*line, line[0]], thick, trim, 8)))
    parts.append(box((0, top + 0.001, 0), (0.86 * taper * width, 0.003, 0.012), c.DARK_METAL).visual_only())
    outline = [(-0.5, 0.92), (0.5, 0.92), (0.5, 0.10), (0.36, -0.12), (-0.36, -0.12), (-0.5, 0.10)]
    flap = [(0.40 * width * x, y * top, size(y * top)[1] / 2 + d) for x, y in outline for d in (-0.004, 0.004)]
    parts.append(convex(flap, trim).visual_only())
    clasp = size(0.0)[1] / 2 + 0.005
    parts.append(box((0, -0.02 * height, clasp), (0.026, 0.020, 0.006), metal).visual_only())
    parts.append(rod((0, -0.02 * height, clasp), (0, -0.02 * height, clasp + 0.006), 0.005, metal).visual_only())
    for sx in (-1, 1):
        for sz in (-1, 1):
            stud = np.array([0.42 * sx * width, -top, 0.36 * sz * depth])
            parts.append(ball(stud, 0.003, metal).visual_only())
    return parts


def draw(rng: np.random.Generator) -> Bag:
    """Generate a random bag that stands upright with the strap raised."""
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
    body = [Solid(convex(corners, look).hull, None), *_leather(width, depth, height, taper, look, strap_look, metal)]
    for side in (-1, 1):
        x = side * span / 2
        body.append(rod((x, top - 0.002, -0.008), (x, top - 0.002, 0.008), 0.006, metal).visual_only())
        body.append(c.hoop((x, top + 0.007, 0), (1, 0, 0), 0.007, 0.0018, metal))
    hinge = np.array([0.0, top + 0.010, 0.0])
    points = arc(hinge, (-1, 0, 0), (0, rise / (span / 2), 0), span / 2, 0.0, np.pi, 8)
    strap = path(points, thick, strap_look, 8)
    return Bag(body, strap, hinge, hinge + np.array([0, rise, 0]), np.array([0, 0.2 * height, depth / 2]))


def lift(rng: np.random.Generator) -> Blueprint:
    bag = draw(rng)
    return c.lifted(bag.body + bag.strap, bag.top, "the middle of the bag's strap")


LIFT = ObjectClass("bag_lift", 2, "prismatic", lift)


def move(rng: np.random.Generator) -> Blueprint:
    bag = draw(rng)
    return c.pushed(bag.body + bag.strap, 0.12, "the middle of the bag's front, near its upper edge", bag.front)


MOVE = ObjectClass("bag_move", 2, "prismatic", move)


def swing(rng: np.random.Generator) -> Blueprint:
    bag = draw(rng)
    return c.hinged(
        bag.body, bag.strap, bag.hinge, (-1, 0, 0), (-1.3, 1.3), head=(bag.top, "the middle of the bag's strap")
    )


SWING = ObjectClass("bag_swing", 2, "revolute", swing)

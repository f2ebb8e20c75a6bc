"""Define a class of generated objects: a refrigerator with one door, or with two doors, where one of them opens."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import Solid, Vec3, ball, box, cone, rod, tray

GAP = 0.0015

SHELF = 0.66
"""Height of the shelf as a fraction of the compartment's height; the hand can put 8 cm tall objects below the shelf."""

REACH = 0.11
"""Distance (m) from the front of a refrigerator to the point at which objects are put into it. The hand reaches only so
far, so the depth of the refrigerator does not matter. Real refrigerators have this point 8 cm behind their front, but a
box that is put down there can fall out.
"""


def _food(
    rng: np.random.Generator, inner: float, depth: float, bottom: float, split: float, wall: float
) -> list[Solid]:
    parts: list[Solid] = []
    for level in (0.0, SHELF):
        floor = bottom + (wall if level == 0 else 0.0025) + level * (split - bottom)
        for k in range(4):
            at = np.array([(k - 1.5) * inner / 4.4, floor, -0.22 * depth])
            look = c.pick(rng, c.PAINTS)
            kind = int(rng.integers(4))
            if kind == 0:
                parts.append(rod(at, at + np.array([0, 0.045, 0]), 0.013, look))
                parts.append(cone(at + np.array([0, 0.045, 0]), at + np.array([0, 0.065, 0]), 0.013, 0.005, look))
            elif kind == 1:
                parts.append(box(at + np.array([0, 0.025, 0]), (0.028, 0.05, 0.028), look))
            elif kind == 2:
                parts.append(ball(at + np.array([0, 0.014, 0]), 0.014, look))
    return [part.visual_only() for part in parts]


def _with_door(body: list[Solid], door: list[Solid], hinge: Vec3, handle: Vec3, inside: Vec3) -> Blueprint:
    return c.hinged(
        body,
        door,
        hinge,
        (0, -1, 0),
        (0.0, 1.4),
        head=(handle, "the middle of the refrigerator's door handle"),
        inside_base=(inside, "the point inside the refrigerator to place an object"),
    )


def build(rng: np.random.Generator) -> Blueprint:
    width, height, depth = c.between(rng, 0.22, 0.28), c.between(rng, 0.40, 0.48), c.between(rng, 0.20, 0.25)
    share = c.between(rng, 0.60, 0.70)
    wall, door = c.between(rng, 0.012, 0.018), c.between(rng, 0.018, 0.026)
    look = c.pick(rng, (c.WHITE, c.STEEL, *c.PAINTS[:4]))
    metal = c.pick(rng, (c.CHROME, c.STEEL, c.DARK_METAL))
    reach = c.between(rng, 0.030, 0.042)
    round_bar = rng.random() < 0.5

    front, left = depth / 2, -width / 2
    bottom, top = -height / 2, height / 2
    split = bottom + share * height
    body = tray((0, (bottom + split) / 2, 0), (width, split - bottom, depth), wall, look, "+z")
    body.append(box((0, (split + top) / 2, 0), (width, top - split, depth), look))
    body += c.feet(width, depth, bottom, 0.010, 0.012)
    z = front + GAP
    freezer = (width, top - split - 0.006, door)
    body.append(box((0, (split + top) / 2 + 0.002, z + door / 2), freezer, look, 0.004))
    handle_x = left + 0.9 * width
    upper = np.array([handle_x, split + 0.5 * (top - split), z + door + reach])
    body += c.bar_handle(upper, 0.55 * (top - split), "y", reach, 0.006, metal)
    shelf = bottom + SHELF * (split - bottom)
    body.append(box((0, shelf, -0.02), (width - 2 * wall, 0.005, 0.75 * depth), c.GLASS, 0.0))
    body += _food(c.extra(rng), width - 2 * wall, depth, bottom, split, wall)
    plate = np.array([0.0, split + 0.80 * (top - split), z + door])
    body.append(box(plate, (0.24 * width, 0.010, 0.0015), metal, 0.0005).visual_only())
    tall = split - bottom - 0.006
    y = (bottom + split) / 2
    span = width - 0.002
    shape = [box((left + span / 2, y, z + door / 2), (span, tall, door), look, 0.004)]
    for level in (0.3, 0.6):
        bin_at = (left + span / 2, bottom + level * tall, z - 0.012)
        shape.append(box(bin_at, (0.7 * span, 0.03, 0.02), c.GLASS, 0.0).visual_only())
    at = np.array([handle_x, y + 0.12 * tall, z + door + reach])
    length = c.between(rng, 0.35, 0.6) * tall
    if round_bar:
        shape += c.bar_handle(at, length, "y", reach, 0.006, metal)
    else:
        shape += c.flat_handle(at, length, "y", reach, 0.013, metal)
    return _with_door(body, shape, (left, 0, z), at, (0, bottom + wall + 0.10, front - REACH))


def tall(rng: np.random.Generator) -> Blueprint:
    """Generate a random refrigerator with one tall door, or with two tall doors of which the left opens."""
    two = rng.random() < 0.6
    own = c.between(rng, 0.20, 0.26)
    beside = c.between(rng, 0.18, 0.27) if two else 0.0
    height, depth = c.between(rng, 0.48, 0.78), c.between(rng, 0.24, 0.40)
    wall, door = c.between(rng, 0.012, 0.022), c.between(rng, 0.018, 0.045)
    look = c.pick(rng, (c.WHITE, c.WHITE, c.STEEL, *c.PAINTS[:4]))
    metal = c.pick(rng, (c.CHROME, c.STEEL, c.DARK_METAL, c.BRASS))
    reach, thick = c.between(rng, 0.026, 0.042), c.between(rng, 0.005, 0.008)
    tall_share, round_bar = c.between(rng, 0.12, 0.5), rng.random() < 0.6

    width = own + beside
    left, front, bottom = -width / 2, depth / 2, -height / 2
    middle = left + own / 2
    body = tray((middle, 0, 0), (own, height, depth), wall, look, "+z")
    z, high = front + GAP, height - 0.006
    if two:
        x = left + own + beside / 2
        body.append(box((x, 0, 0), (beside, height, depth), look))
        body.append(box((x + 0.001, 0, z + door / 2), (beside - 0.004, high, door), look, 0.004))
        other = np.array([left + own + 0.12 * beside, 0.05 * height, z + door + reach])
        body += c.bar_handle(other, tall_share * high, "y", reach, thick, metal)
    body += c.feet(width, depth, bottom, 0.010, 0.012)
    shelf = bottom + SHELF * height
    body.append(box((middle, shelf, -0.02), (own - 2 * wall, 0.005, 0.75 * depth), c.GLASS, 0.0))
    span = own - 0.002
    shape = [box((left + span / 2, 0, z + door / 2), (span, high, door), look, 0.004)]
    at = np.array([left + 0.88 * own, c.between(rng, -0.05, 0.12) * height, z + door + reach])
    if round_bar:
        shape += c.bar_handle(at, tall_share * high, "y", reach, thick, metal)
    else:
        shape += c.flat_handle(at, tall_share * high, "y", reach, 2 * thick, metal)
    return _with_door(body, shape, (left, 0, z), at, (middle, bottom + wall + 0.10, front - REACH))


OBJECT_CLASS = ObjectClass("refrigerator", 2, "revolute", build, (tall,))

"""Define three kinds of buckets.

Some are lifted, some are pushed, and some have a wire handle that swings.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gensim2.core.arrays import Array
from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import Solid, arc, ball, cone, path, rod, tube


@dataclass(frozen=True)
class Bucket:
    """Parts of a bucket with the handle up.

    ``hinge`` (3,) is the middle of the axis of the handle, and ``top`` (3,) the highest point of the handle.
    """

    body: list[Solid]
    handle: list[Solid]
    hinge: Array
    top: Array
    front: Array
    height: float


def draw(rng: np.random.Generator) -> Bucket:
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
    # The handle with its grip must not touch the rim while it swings down.
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


def pail(rng: np.random.Generator) -> Bucket:
    """Generate a random pail: bands around its rim, a thin wire handle hinged below them, and often some content."""
    height, wide = c.between(rng, 0.13, 0.20), c.between(rng, 0.07, 0.105)
    narrow = wide * c.between(rng, 0.72, 0.96)
    wall, thick = c.between(rng, 0.004, 0.006), c.between(rng, 0.0028, 0.0045)
    look = c.pick(rng, (*c.PAINTS, c.WHITE, c.STEEL))
    wire = c.pick(rng, (c.STEEL, c.DARK_METAL))
    bands, deep = int(rng.integers(0, 4)), c.between(rng, 0.012, 0.30 * height)
    straight = 0.0 if rng.random() < 0.6 else c.between(rng, 0.01, 0.05)
    full = 0.0 if rng.random() < 0.5 else c.between(rng, 0.6, 0.97)
    grip = c.between(rng, 0.02, 0.04) if rng.random() < 0.3 else 0.0

    bottom, top = -height / 2, height / 2

    def radius(y: float) -> float:
        return narrow + (wide - narrow) * (y - bottom) / height

    body = tube((0, bottom, 0), (0, top, 0), narrow, wide, wall, look, 12, bottom=0.006)
    body.append(c.hoop((0, top, 0), (0, 1, 0), wide - wall / 2, 0.7 * wall, look))
    for band in range(bands):
        y = top - (band + 1) * deep / (bands + 1)
        body.append(c.hoop((0, y, 0), (0, 1, 0), radius(y), 0.8 * wall, look))
    if full:
        y = bottom + full * height
        inner = radius(y) - 1.5 * wall
        body.append(cone((0, y - 0.006, 0), (0, y, 0), inner, inner, c.pick(rng, c.WOODS + c.PAINTS)))
    # Neither the wire nor the grip may touch the rim or the wall of the bucket when the handle swings.
    half = float(np.hypot(wide, deep)) + 0.012 + thick + (0.004 if grip else 0.0)
    hinge = np.array([0.0, top - deep, 0.0])
    for side in (-1, 1):
        ear = hinge + np.array([side * radius(hinge[1]), 0, 0])
        end = hinge + np.array([side * half, 0, 0])
        body.append(rod(ear, end, c.between(rng, 0.004, 0.008), wire).visual_only())
    up = np.array([0, straight, 0])
    bow = arc(hinge + up, (-1, 0, 0), (0, 1.0, 0), half, 0.0, np.pi, 10)
    points = [*([bow[0] - up] if straight else []), *bow, *([bow[-1] - up] if straight else [])]
    handle = path(points, thick, wire, 8)
    crown = hinge + up + np.array([0, half, 0])
    if grip:
        ends = np.array([grip, 0, 0])
        handle.append(rod(crown - ends, crown + ends, thick + 0.004, c.pick(rng, (c.BLACK, *c.WOODS)), 10))
    return Bucket(body, handle, hinge, crown, np.array([0, top - 0.01, wide]), height)


def lift(rng: np.random.Generator) -> Blueprint:
    bucket = draw(rng)
    above = bucket.top + np.array([0, 0.05, 0.05])
    inlet = (above, "the point above the bucket from which to drop an object into it")
    return c.lifted(bucket.body + bucket.handle, bucket.top, "the middle of the bucket's handle", above=inlet)


LIFT = ObjectClass("bucket_lift", 5, "prismatic", lift)


def move(rng: np.random.Generator) -> Blueprint:
    bucket = draw(rng)
    folded = c.turned(bucket.handle, bucket.hinge, (-1, 0, 0), 1.3)
    return c.pushed(bucket.body + folded, 0.25, "the nearest point of the bucket's rim", bucket.front)


MOVE = ObjectClass("bucket_move", 2, "prismatic", move)


def _swinging(bucket: Bucket) -> Blueprint:
    return c.hinged(
        bucket.body,
        bucket.handle,
        bucket.hinge,
        (-1, 0, 0),
        (-1.45, 1.45),
        head=(bucket.top, "the middle of the bucket's handle"),
    )


def swing(rng: np.random.Generator) -> Blueprint:
    return _swinging(draw(rng))


def swinging_pail(rng: np.random.Generator) -> Blueprint:
    """Generate a random pail whose wire handle swings."""
    return _swinging(pail(rng))


SWING = ObjectClass("bucket_swing", 26, "revolute", swing, (swinging_pail,))

"""Define a class of generated objects: a door, in a frame or a wall, that opens away from the robot."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import Solid, Vec3, box, path, rod

GAP = 0.003


def _hung(body: list[Solid], leaf: list[Solid], hinge: Vec3, edge: Vec3) -> Blueprint:
    return c.hinged(body, leaf, hinge, (0, 1, 0), (0.0, 1.4), head=(edge, "the middle of the door's free edge"))


def build(rng: np.random.Generator) -> Blueprint:
    width, height = c.between(rng, 0.20, 0.26), c.between(rng, 0.36, 0.44)
    post, deep = c.between(rng, 0.022, 0.032), c.between(rng, 0.05, 0.07)
    leaf = c.between(rng, 0.014, 0.020)
    wood = c.pick(rng, (*c.WOODS, *c.PAINTS))
    frame = c.pick(rng, (*c.WOODS, c.WHITE))
    metal = c.pick(rng, c.METALS)
    panels = int(rng.integers(0, 3))

    top = height / 2
    body = [box((s * (width + post) / 2, 0, 0), (post, height, deep), frame) for s in (-1, 1)]
    body.append(box((0, top + post / 2, 0), (width + 2 * post, post, deep), frame))
    body.append(box((0, -top - 0.006, 0), (width + 2 * post + 0.06, 0.012, 0.16), frame))
    # The door leaf is flush with the back of the frame, so that it does not touch the posts when it swings.
    z = -deep / 2 + leaf / 2
    span, tall = width - 2 * GAP, height - 2 * GAP
    shape = [box((0, 0, z), (span, tall, leaf), wood)]
    for k in range(panels):
        y = (k + 0.5) / panels * 0.8 * tall - 0.4 * tall
        for face in (-1, 1):
            inset = (0.66 * span, 0.62 * tall / panels, 0.004)
            shape.append(box((0, y, z + face * leaf / 2), inset, wood, 0.002).visual_only())
    lever_x, lever_y = 0.38 * span, -0.05 * height
    for face in (-1, 1):
        foot = np.array([lever_x, lever_y, z + face * leaf / 2])
        out = foot + np.array([0, 0, face * 0.026])
        shape += path([foot, out, out - np.array([0.05, 0, 0])], 0.005, metal, 8)
        shape.append(rod(foot, foot + np.array([0, 0, face * 0.004]), 0.014, metal).visual_only())
    for y in (-0.3, 0.3):
        pin = np.array([-width / 2, y * height, -deep / 2])
        body.append(rod(pin - np.array([0, 0.015, 0]), pin + np.array([0, 0.015, 0]), 0.005, metal).visual_only())
    edge = np.array([0.46 * span, lever_y + 0.05, z + leaf / 2])
    return _hung(body, shape, (-width / 2, 0, -deep / 2), edge)


def in_a_wall(rng: np.random.Generator) -> Blueprint:
    """Generate a random door in a piece of wall.

    Some of these doors have a lever, and many are larger than framed doors.
    """
    width, height = c.between(rng, 0.11, 0.26), c.between(rng, 0.40, 0.56)
    sides = [c.between(rng, 0.03, 0.28) for _ in range(2)]
    above, deep = c.between(rng, 0.01, 0.22), c.between(rng, 0.02, 0.08)
    leaf = min(c.between(rng, 0.006, 0.028), deep)
    wall = c.pick(rng, (c.WHITE, *c.PAINTS, *c.WOODS))
    look = c.pick(rng, (c.WHITE, *c.PAINTS, *c.WOODS))
    metal = c.pick(rng, c.METALS)
    has_lever, glazed = rng.random() < 0.4, rng.random() < 0.4
    inset = c.between(rng, 0.0, deep - leaf)

    bottom, top = -height / 2, height / 2
    body = [
        box((s * (width + side) / 2, above / 2, 0), (side, height + above, deep), wall)
        for s, side in zip((-1, 1), sides, strict=True)
    ]
    body.append(box((0, top + above / 2, 0), (width, above, deep), wall))
    # The hinge is at the back of the leaf. The leaf opens backwards, so the wall never blocks it.
    back = -deep / 2 + (inset if rng.random() < 0.5 else 0.0)
    z, span, tall = back + leaf / 2, width - 2 * GAP, height - 2 * GAP
    shape = [box((0, 0, z), (span, tall, leaf), look)]
    if glazed:
        pane = (0.7 * span, 0.38 * tall, leaf + 0.001)
        shape += [box((0, s * 0.23 * tall, z), pane, c.GLASS, 0.0).visual_only() for s in (-1, 1)]
    lever_x, lever_y = 0.38 * span, c.between(rng, -0.08, 0.06) * height
    if has_lever:
        for face in (-1, 1):
            foot = np.array([lever_x, lever_y, z + face * leaf / 2])
            out = foot + np.array([0, 0, face * 0.022])
            shape += path([foot, out, out - np.array([0.2 * width, 0, 0])], 0.005, metal, 8)
    edge = np.array([0.44 * span, lever_y + 0.05, z + leaf / 2])
    body.append(box((0, bottom + 0.004, back - 0.01), (width, 0.004, 0.01), wall).visual_only())
    return _hung(body, shape, (-width / 2, 0, back), edge)


OBJECT_CLASS = ObjectClass("door", 2, "revolute", build, (in_a_wall,))

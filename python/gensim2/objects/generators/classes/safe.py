"""Define two classes of generated safes: safes whose door is opened and closed, and safes that are pushed."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import Look, Solid, ball, box, rod, tray

GAP = 0.0015


def _wheel(at: np.ndarray, reach: float, radius: float, look: Look) -> list[Solid]:
    hub = at - np.array([0, 0, reach])
    parts = [rod(hub, at, 0.3 * radius, look, 10)]
    for k in range(4):
        tip = at + radius * np.array([np.cos(k * np.pi / 2 + 0.4), np.sin(k * np.pi / 2 + 0.4), 0])
        parts += [rod(at, tip, 0.004, look, 8), ball(tip, 0.007, look)]
    return parts


def rotate(rng: np.random.Generator) -> Blueprint:
    width, height, depth = c.between(rng, 0.22, 0.30), c.between(rng, 0.22, 0.32), c.between(rng, 0.19, 0.25)
    wall, door = c.between(rng, 0.014, 0.022), c.between(rng, 0.016, 0.024)
    look = c.pick(rng, (c.PAINTS[5], c.PAINTS[3], c.DARK_METAL, c.STEEL, c.WHITE))
    metal = c.pick(rng, (c.CHROME, c.BRASS, c.STEEL))
    kind = int(rng.integers(3))
    reach = c.between(rng, 0.034, 0.048)

    front, right = depth / 2, width / 2
    body = tray((0, 0, 0), (width, height, depth), wall, look, "+z")
    body += c.feet(width, depth, -height / 2, 0.008, 0.012, c.DARK_METAL)
    origin = np.array([right, 0.0, front + GAP])
    span = width - 0.002
    face = front + GAP + door
    shape = [box((right - span / 2, 0, front + GAP + door / 2), (span, height - 0.002, door), look, 0.003)]
    inset = (0.86 * span, 0.88 * height, 0.002)
    shape.append(box((right - span / 2, 0, face), inset, c.pick(rng, (look, c.DARK_METAL)), 0.0).visual_only())
    at = np.array([right - span * c.between(rng, 0.78, 0.86), c.between(rng, -0.12, 0.05) * height, face + reach])
    if kind == 0:
        shape += c.bar_handle(at, c.between(rng, 0.30, 0.45) * height, "y", reach, 0.007, metal)
    elif kind == 1:
        shape += c.flat_handle(at, c.between(rng, 0.30, 0.45) * height, "y", reach, 0.015, metal)
    else:
        at = at + np.array([0.06 * span, 0, 0])
        shape += _wheel(at, reach, c.between(rng, 0.030, 0.040), metal)
    dial = np.array([right - 0.45 * span, 0.22 * height, face])
    if rng.random() < 0.5:
        shape.append(rod(dial, dial + np.array([0, 0, 0.014]), 0.022, metal).visual_only())
        shape.append(rod(dial, dial + np.array([0, 0, 0.003]), 0.032, c.BLACK).visual_only())
    else:
        shape.append(box(dial + np.array([0, 0, 0.003]), (0.06, 0.07, 0.006), c.BLACK).visual_only())
        for i in range(3):
            for j in range(3):
                key = dial + np.array([(i - 1) * 0.017, (j - 1) * 0.018 - 0.006, 0.006])
                shape.append(box(key, (0.012, 0.012, 0.003), c.WHITE, 0.0).visual_only())
        shape.append(box(dial + np.array([0, 0.027, 0.006]), (0.046, 0.010, 0.002), c.DISPLAY, 0.0).visual_only())
    for y in (-0.32, 0.32):
        foot, tip = ((right + 0.004, y * height - 0.02, front + GAP), (right + 0.004, y * height + 0.02, front + GAP))
        body.append(rod(foot, tip, 0.006, metal).visual_only())
    return c.hinged(
        body,
        shape,
        origin,
        (0, 1, 0),
        (0.0, np.pi / 2),
        head=(at, "the middle of the safe's door handle"),
        inside_base=((0, 0, 0), "the point inside the safe to put an object"),
    )


ROTATE = ObjectClass("safe_rotate", 15, "revolute", rotate)


def move(rng: np.random.Generator) -> Blueprint:
    whole = rotate(rng)
    low, high = c.bounds(whole.moving[:1])  # the first moving part is the door panel; the handle is a later part
    head = (0.0, 0.25 * low[1] + 0.75 * high[1], high[2])
    return c.pushed(c.at(whole, whole.limits[0]), 0.25, "the middle of the safe's front, near its upper edge", head)


MOVE = ObjectClass("safe_move", 2, "prismatic", move)

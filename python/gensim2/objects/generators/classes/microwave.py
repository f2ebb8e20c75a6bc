"""Define a class of generated objects: a microwave oven with its door on the left."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import Look, box, rod, tray

GAP = 0.0015
GLASS_PLATE = Look((0.75, 0.82, 0.85, 0.6), 0.0, 0.05)


def build(rng: np.random.Generator) -> Blueprint:
    width, height, depth = c.between(rng, 0.33, 0.42), c.between(rng, 0.19, 0.25), c.between(rng, 0.20, 0.26)
    panel = c.between(rng, 0.07, 0.10)
    wall, door = c.between(rng, 0.008, 0.014), c.between(rng, 0.015, 0.024)
    look = c.pick(rng, (c.WHITE, c.STEEL, c.BLACK, c.PAINTS[1], c.PAINTS[5]))
    door_look = look if rng.random() < 0.5 else c.pick(rng, (c.BLACK, c.STEEL))
    metal = c.pick(rng, (c.CHROME, c.STEEL, c.DARK_METAL))
    reach = c.between(rng, 0.028, 0.042)
    knobs = rng.random() < 0.5

    front = depth / 2
    left = -width / 2
    cavity = width - panel
    body = tray((left + cavity / 2, 0, 0), (cavity, height, depth), wall, look, "+z")
    body.append(box((width / 2 - panel / 2, 0, 0), (panel, height, depth), look))
    body += c.feet(width, depth, -height / 2, 0.008, 0.010)
    panel_x = width / 2 - panel / 2
    body.append(box((panel_x, 0, front + 0.001), (0.9 * panel, 0.94 * height, 0.002), c.BLACK, 0.0).visual_only())
    body.append(
        box((panel_x, 0.34 * height, front + 0.0025), (0.7 * panel, 0.12 * height, 0.001), c.DISPLAY, 0.0).visual_only()
    )
    if knobs:
        for y in (0.08, -0.22):
            at = np.array([panel_x, y * height, front + 0.002])
            body.append(rod(at, at + np.array([0, 0, 0.012]), 0.28 * panel, metal).visual_only())
    else:
        for i in range(3):
            for j in range(4):
                key = (panel_x + (i - 1) * 0.25 * panel, (0.14 - 0.14 * j) * height, front + 0.003)
                body.append(box(key, (0.18 * panel, 0.08 * height, 0.002), c.STEEL, 0.0005).visual_only())

    plate = np.array([left + cavity / 2, -height / 2 + wall, 0.0])
    glass = 0.42 * min(cavity - 2 * wall, depth - wall)
    body.append(rod(plate, plate + np.array([0, 0.006, 0]), glass, GLASS_PLATE, 20).visual_only())
    for k in range(7):
        slit = (width / 2, 0.05 * height, (k - 3) * 0.014 - 0.15 * depth)
        body.append(box(slit, (0.001, 0.3 * height, 0.006), c.BLACK, 0.0).visual_only())
    body.append(
        box((panel_x, -0.40 * height, front + 0.003), (0.72 * panel, 0.09 * height, 0.003), metal).visual_only()
    )

    origin = np.array([left, 0.0, front + GAP])
    span = cavity - 0.002
    middle = front + GAP + door / 2
    shape = [box((left + span / 2, 0, middle), (span, height - 0.004, door), door_look, 0.003)]
    window = (0.72 * span, 0.66 * height, 0.002)
    shape.append(box((left + 0.46 * span, 0, front + GAP + door), window, c.GLASS, 0.0).visual_only())
    at = np.array([left + 0.93 * span, 0, front + GAP + door + reach])
    length = c.between(rng, 0.5, 0.75) * height
    if rng.random() < 0.5:
        shape += c.bar_handle(at, length, "y", reach, 0.006, metal)
    else:
        shape += c.flat_handle(at, length, "y", reach, 0.013, metal)
    return c.hinged(
        body,
        shape,
        origin,
        (0, -1, 0),
        (0.0, np.pi / 2),
        head=(at, "the middle of the microwave's door handle"),
        inside_base=((left + cavity / 2, -0.1 * height, 0), "the point inside the microwave to put an object"),
    )


OBJECT_CLASS = ObjectClass("microwave", 10, "revolute", build)

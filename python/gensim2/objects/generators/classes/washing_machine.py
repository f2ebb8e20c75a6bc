"""Define a class of generated objects: a washing machine with a round door hinged at the left."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import Look, box, cone, rod, tray, tube, turned_profile

GAP = 0.0015
BLUE = Look((0.25, 0.40, 0.52, 0.75), 0.0, 0.05)


def build(rng: np.random.Generator) -> Blueprint:
    width, height, depth = c.between(rng, 0.26, 0.32), c.between(rng, 0.29, 0.35), c.between(rng, 0.22, 0.27)
    radius = c.between(rng, 0.080, 0.095)
    door = c.between(rng, 0.016, 0.022)
    look = c.pick(rng, (c.WHITE, c.STEEL, c.PAINTS[5]))
    metal = c.pick(rng, (c.CHROME, c.STEEL, c.DARK_METAL))
    reach = c.between(rng, 0.024, 0.032)

    front = depth / 2
    wall = 0.012
    hole = 1.5 * radius
    y0 = -0.04 * height
    body = tray((0, 0, -wall / 2), (width, height, depth - wall), wall, look, "+z")
    z = front - wall / 2
    side, over, under = (width - hole) / 2, height / 2 - y0 - hole / 2, height / 2 + y0 - hole / 2
    for sx in (-1, 1):
        body.append(box((sx * (width - side) / 2, 0, z), (side, height, wall), look))
    body.append(box((0, height / 2 - over / 2, z), (hole, over, wall), look))
    body.append(box((0, -height / 2 + under / 2, z), (hole, under, wall), look))
    body += c.feet(width, depth, -height / 2, 0.008, 0.012)
    drum = tube((0, y0, front - wall), (0, y0, -0.3 * depth), 0.72 * radius, 0.72 * radius, 0.003, c.STEEL, 16)
    body += [part.visual_only() for part in drum]
    # The front is drawn as a plate with a round hole. For collisions, it consists of four bars around a square hole.
    disc = [(1.10 * radius, 0.0), (1.10 * radius, 1.0), (0.70 * radius, 1.0), (0.70 * radius, 0.0)]
    body.append(turned_profile((0, y0, front), (0, y0, front + 0.001), disc, look))
    body.append(c.hoop((0, y0, front), (0, 0, 1), 0.71 * radius, 0.004, c.RUBBER))
    panel_y = height / 2 - 0.032
    body.append(box((0, panel_y, front + 0.001), (0.94 * width, 0.046, 0.002), c.BLACK, 0.0).visual_only())
    knob = np.array([0.0, panel_y, front + 0.002])
    body.append(rod(knob, knob + np.array([0, 0, 0.010]), 0.016, metal).visual_only())
    body.append(box((-0.32 * width, panel_y, front + 0.003), (0.07, 0.03, 0.002), look, 0.0).visual_only())
    body.append(box((0.28 * width, panel_y, front + 0.003), (0.05, 0.018, 0.002), c.DISPLAY, 0.0).visual_only())

    face = front + GAP + 0.002
    middle = np.array([0.0, y0, face])
    shape = tube(middle, middle + np.array([0, 0, door]), radius, 0.94 * radius, 0.022, metal, 12)
    shape.append(rod(middle, middle + np.array([0, 0, 0.5 * door]), radius - 0.020, c.GLASS, 16))
    inner, outer = (middle + np.array([0, 0, share * door]) for share in (0.45, 0.8))
    bulge = cone(inner, outer, 0.70 * radius, 0.45 * radius, BLUE)
    shape.append(bulge.visual_only())
    at = np.array([0.86 * radius, y0, face + door + reach])
    shape += c.flat_handle(at, 0.070, "y", reach, 0.013, metal)
    origin = np.array([-radius - 0.004, y0, face])
    return c.hinged(
        body,
        shape,
        origin,
        (0, -1, 0),
        (0.0, 1.7),
        head=(at, "the middle of the handle at the edge of the machine's door"),
        tail=(origin + np.array([0.006, 0, door / 2]), "the middle of the hinge between the machine's door and body"),
    )


OBJECT_CLASS = ObjectClass("washing_machine", 2, "revolute", build)

"""Define two classes of generated boxes: boxes whose hinged lid is opened and closed, and boxes that are pushed."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import Look, Solid, box, rod, tray

GAP = 0.001  # m, distance between lid and rim


def _trim(
    rng: np.random.Generator, size: tuple[float, float, float], lid: tuple[float, float], metal: Look, lock: bool
) -> tuple[list[Solid], list[Solid]]:
    """Generate random fittings for the body and the lid of a box, which are visible but have no collision shape.

    A box has corner plates, straps, plank lines or no fittings. With ``lock`` it also has a lock plate.

    Args:
        size: width, height, depth of the body, m.
        lid: height (y) of the lid's upper face, and thickness of the lid, m.
        metal: material of the fittings.
        lock: whether to add a lock plate.
    """
    width, height, depth = size
    top, front = height / 2, depth / 2
    lid_top, thick = lid
    skin = 0.0012
    on_body: list[Solid] = []
    on_lid: list[Solid] = []
    style = int(rng.integers(4))
    if style == 0:  # metal plates on the corners
        arm = float(rng.uniform(0.020, 0.030))
        for sx in (-1, 1):
            for y in (-top + arm / 2, top - arm / 2):
                for sz in (-1, 1):
                    corner = (sx * (width - arm) / 2, y, sz * front)
                    on_body.append(box(corner, (arm, arm, 2 * skin), metal, 0.0005))
                    side = (sx * width / 2, y, sz * (depth - arm) / 2)
                    on_body.append(box(side, (2 * skin, arm, arm), metal, 0.0005))
            on_lid.append(box((sx * (width - arm) / 2, lid_top, front - arm / 2), (arm, 2 * skin, arm), metal, 0.0005))
    elif style == 1:  # straps around the box
        band = c.pick(rng, (*c.WOODS, c.BLACK, metal))
        for sx in (-1, 1):
            x = sx * 0.28 * width
            for sz in (-1, 1):
                on_body.append(box((x, 0, sz * front), (0.022, height, 2 * skin), band, 0.0005))
            on_lid.append(box((x, lid_top - thick / 2, 0.001), (0.022, thick + 2 * skin, depth - 0.002), band, 0.0005))
    elif style == 2:  # planks
        dark = Look((0.10, 0.07, 0.05, 1), 0.0, 0.9)
        count = max(2, round(height / 0.035))
        for k in range(1, count):
            y = -top + k * height / count
            for s in (-1, 1):
                on_body.append(box((0, y, s * front), (width, 0.0018, 0.0006), dark, 0.0))
                on_body.append(box((s * width / 2, y, 0), (0.0006, 0.0018, depth), dark, 0.0))
        for k in range(1, 4):
            z = -front + k * depth / 4
            on_lid.append(box((0, lid_top, z), (width + 0.0006, 0.0006, 0.0018), dark, 0.0))
    if lock:
        on_body.append(box((0, top - 0.016, front), (0.030, 0.026, 2 * skin), metal, 0.0006))
        on_body.append(rod((0, top - 0.018, front), (0, top - 0.018, front + 2 * skin), 0.003, c.BLACK))
    return [part.visual_only() for part in on_body], [part.visual_only() for part in on_lid]


def rotate(rng: np.random.Generator) -> Blueprint:
    width, depth, height = c.between(rng, 0.20, 0.32), c.between(rng, 0.15, 0.21), c.between(rng, 0.07, 0.13)
    wall, plate = c.between(rng, 0.005, 0.010), c.between(rng, 0.006, 0.011)
    overhang = c.between(rng, 0.008, 0.020)
    hollow_lid = rng.random() < 0.35
    rim = c.between(rng, 0.018, 0.035) if hollow_lid else 0.0
    tilt = c.between(rng, 0.0, 0.25)
    look = c.pick(rng, c.WOODS + c.PAINTS)
    lid_look = look if rng.random() < 0.5 else c.pick(rng, c.WOODS + c.PAINTS)
    metal = c.pick(rng, c.METALS)
    tab = rng.random() < 0.6

    top, back, front = height / 2, -depth / 2, depth / 2
    body = tray((0, 0, 0), (width, height, depth), wall, look, "+y")
    if rng.random() < 0.5:
        body += c.feet(width, depth, -top, 0.006, 0.008, metal)
    origin = np.array([0.0, top + GAP, back])
    lid_top = top + GAP + rim + plate
    if hollow_lid:
        lid = tray((0, top + GAP + (rim + plate) / 2, 0), (width, rim + plate, depth), wall, lid_look, "-y", plate)
        lid.append(box((0, top + GAP + plate / 2, front + overhang / 2), (0.4 * width, plate, overhang), lid_look))
    else:
        length = depth + overhang
        lid = [box((0, lid_top - plate / 2, back + length / 2), (width, plate, length), lid_look)]
    if tab:
        lid.append(box((0, top + GAP + plate / 2, front + overhang + 0.004), (0.16 * width, 0.7 * plate, 0.012), metal))
    reach = front + overhang + (0.01 if tab else 0.0)
    for side in (-1, 1):
        x = side * 0.3 * width
        body.append(
            rod(
                (x - 0.015, top - 0.004, back - 0.003), (x + 0.015, top - 0.004, back - 0.003), 0.003, metal
            ).visual_only()
        )

    trimmed, on_lid = _trim(c.extra(rng), (width, height, depth), (lid_top, plate + rim), metal, tab)
    body += trimmed
    lid += on_lid

    head, tail = (0, top + GAP + plate / 2, reach), (0, top + GAP, back)
    # As in most boxes of the GenSim2 release, a joint value of -90 degrees means that the box is closed.
    return c.upright_lid(
        body,
        lid,
        origin,
        tilt - 0.15,
        (head, "the midpoint of the front edge of the box lid"),
        (tail, "the midpoint of the hinge between the box lid and the body"),
        inside_base=((0, top + 0.06, 0), "the point from which to drop an object into the box"),
    )


ROTATE = ObjectClass("box_rotate", 13, "revolute", rotate)


def move(rng: np.random.Generator) -> Blueprint:
    whole = rotate(rng)
    low, high = c.bounds(whole.body)
    head = (0.0, 0.3 * low[1] + 0.7 * high[1], high[2])
    return c.pushed(c.at(whole, whole.limits[0]), 0.2, "the middle of the box's front, near its upper edge", head)


MOVE = ObjectClass("box_move", 1, "prismatic", move)

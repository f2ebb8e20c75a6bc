"""Define two classes of generated laptops: laptops whose screen is opened and closed, and laptops that are pushed."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import Look, Solid, Vec3, box, rod, rounded_box

GAP = 0.001


def keyboard(width: float, depth: float, top: float, keys: Look) -> list[Solid]:
    """Return the keys and the touch pad on the surface at height ``top``. These parts have no collision shape."""
    rows, columns = 5, 13
    field_w, field_d = 0.88 * width, 0.42 * depth
    pitch_x, pitch_z = field_w / columns, field_d / rows
    z0 = -0.5 * depth + 0.12 * depth
    parts = [
        box(
            (-field_w / 2 + (i + 0.5) * pitch_x, top + 0.0006, z0 + (j + 0.5) * pitch_z),
            (0.82 * pitch_x, 0.0012, 0.82 * pitch_z),
            keys,
            0.0,
        ).visual_only()
        for j in range(rows)
        for i in range(columns)
        if not (j == rows - 1 and 3 <= i <= 8)
    ]
    space = (-field_w / 2 + 6 * pitch_x, top + 0.0006, z0 + (rows - 0.5) * pitch_z)
    parts.append(box(space, (5.8 * pitch_x, 0.0012, 0.82 * pitch_z), keys, 0.0).visual_only())
    pad = box((0, top + 0.0003, 0.5 * depth - 0.2 * depth), (0.3 * width, 0.0006, 0.26 * depth), c.DARK_METAL, 0.0)
    return [*parts, pad.visual_only()]


def _desktop(rng: np.random.Generator, middle: Vec3, width: float, depth: float) -> list[Solid]:
    x, y, z = (float(v) for v in middle)
    bar = box((x, y, z - 0.46 * depth), (width, 0.0004, 0.06 * depth), c.STEEL, 0.0)
    parts = [bar.visual_only()]
    for k in range(2):
        w, d = rng.uniform(0.30, 0.50) * width, rng.uniform(0.35, 0.50) * depth
        at = (x + (k - 0.5) * 0.40 * width, y - 0.0002 * k, z + rng.uniform(0.0, 0.12) * depth)
        parts.append(box(at, (w, 0.0004, d), c.WHITE, 0.0).visual_only())
        title = (at[0], y - 0.0002 * k - 0.0002, at[2] + 0.45 * d)
        parts.append(box(title, (w, 0.0004, 0.1 * d), c.pick(rng, c.PAINTS[1:5]), 0.0).visual_only())
    return parts


def rotate(rng: np.random.Generator) -> Blueprint:
    width, depth = c.between(rng, 0.27, 0.34), c.between(rng, 0.185, 0.225)
    base, plate = c.between(rng, 0.012, 0.022), c.between(rng, 0.005, 0.009)
    look = c.pick(rng, (c.STEEL, c.DARK_METAL, c.WHITE, c.BLACK))
    lip = c.between(rng, 0.0, 0.004)
    widest = c.between(rng, 0.10, 0.45)

    top = base / 2
    back = -depth / 2
    body = [
        rounded_box((0, 0, 0), (width, base, depth), look, 0.012),
        *keyboard(width, depth, top, c.STEEL if sum(look.rgba[:3]) < 0.2 else c.BLACK),
    ]
    body += [part.visual_only() for part in c.feet(width, depth, -top + 0.0015, 0.0015, 0.006)]
    origin = np.array([0.0, top + GAP, back + 0.001])
    length = depth + lip
    height = top + GAP + plate / 2
    lid = [
        rounded_box((0, height, back + 0.001 + length / 2), (width, plate, length), look, 0.012),
        box(
            (0, top + GAP - 0.0004, back + length / 2), (0.9 * width, 0.001, 0.84 * length), c.SCREEN, 0.0
        ).visual_only(),
        rod(
            (-0.3 * width, top + GAP, back + 0.002), (0.3 * width, top + GAP, back + 0.002), 0.0035, c.BLACK
        ).visual_only(),
    ]
    detail = c.extra(rng)
    lid += _desktop(detail, (0, top + GAP - 0.0009, back + length / 2), 0.9 * width, 0.84 * length)
    logo = np.array([0, top + GAP + plate, back + 0.5 * length])
    logo_look = c.pick(detail, (c.CHROME, c.WHITE, *c.PAINTS[1:5]))
    lid.append(rod(logo, logo + np.array([0, 0.0006, 0]), 0.018, logo_look).visual_only())
    for s in (-1, 1):
        for k in range(int(detail.integers(2, 5))):
            port = (s * width / 2, -0.1 * base, back + 0.04 + 0.018 * k)
            body.append(box(port, (0.0008, 0.30 * base, 0.011), c.BLACK, 0.0).visual_only())
    head, tail = (0, height, back + 0.001 + length), (0, top + GAP, back + 0.001)
    return c.upright_lid(
        body,
        lid,
        origin,
        widest,
        (head, "the midpoint of the far edge of the laptop's screen"),
        (tail, "the midpoint of the hinge between the laptop's screen and its keyboard"),
        surface_base=((0, top + 0.06, 0.1 * depth), "the point above the laptop's keyboard"),
    )


ROTATE = ObjectClass("laptop_rotate", 44, "revolute", rotate)


def move(rng: np.random.Generator) -> Blueprint:
    whole = rotate(rng)
    low, high = c.bounds(whole.body)
    head = (0.0, 0.3 * low[1] + 0.7 * high[1], high[2])
    # 70 % of the laptops that are pushed are open, because people often push open laptops aside.
    share = 0.9 if c.extra(rng).random() < 0.7 else 0.0
    screen = whole.limits[0] + share * (whole.limits[1] - whole.limits[0])
    return c.pushed(c.at(whole, screen), 0.25, "the middle of the laptop's near edge", head)


MOVE = ObjectClass("laptop_move", 3, "prismatic", move)

"""A small cabinet of drawers, one of which slides."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import Solid, ball, box, rod, tray

GAP = 0.002  # m around the sliding drawer
FRONT = 0.012  # m thickness of a drawer's front


def _handle(rng: np.random.Generator, at: np.ndarray, width: float, height: float) -> tuple[list[Solid], float]:
    """A handle in front of ``at`` and how far its middle stands out."""
    look = c.pick(rng, c.METALS)
    kind = int(rng.integers(3))
    reach = c.between(rng, 0.030, 0.042)
    middle = at + np.array([0, 0, reach])
    length = min(c.between(rng, 0.08, 0.14), 0.55 * width)
    if kind == 0:
        return c.bar_handle(middle, length, "x", reach, c.between(rng, 0.0045, 0.0065), look), reach
    if kind == 1:
        return c.flat_handle(middle, length, "x", reach, c.between(rng, 0.010, 0.014), look), reach
    radius = c.between(rng, 0.012, 0.016)
    knob = [rod(at, middle, 0.5 * radius, look, 8), ball(middle, (radius, radius, 0.7 * radius), look)]
    return knob, reach


def build(rng: np.random.Generator) -> Blueprint:
    width, depth = c.between(rng, 0.22, 0.34), c.between(rng, 0.18, 0.25)
    rows = int(rng.integers(1, 4))
    row_height = c.between(rng, 0.075, 0.11)
    wall = c.between(rng, 0.008, 0.014)
    plinth = c.between(rng, 0.0, 0.04)
    stroke = c.between(rng, 0.11, 0.15)
    moving_row = int(rng.integers(rows))
    wood = c.pick(rng, c.WOODS + c.PAINTS)
    front_look = wood if rng.random() < 0.5 else c.pick(rng, c.WOODS + c.PAINTS)

    shelf = wall
    height = plinth + rows * row_height + (rows + 1) * shelf
    bottom = -height / 2
    body: list[Solid] = []
    for side in (-1, 1):
        body.append(box((side * (width - wall) / 2, 0, 0), (wall, height, depth), wood))
    body.append(box((0, 0, -(depth - wall) / 2), (width - 2 * wall, height, wall), wood))
    for row in range(rows + 1):
        y = bottom + plinth + row * (row_height + shelf) + shelf / 2
        body.append(box((0, y, wall / 2), (width - 2 * wall, shelf, depth - wall), wood))

    drawer: list[Solid] = []
    head = inside = np.zeros(3)
    inner_w, inner_d = width - 2 * wall - 2 * GAP, depth - wall - 2 * GAP
    handle_seed = rng.bit_generator.random_raw()
    for row in range(rows):
        y = bottom + plinth + row * (row_height + shelf) + shelf + row_height / 2
        # Fronts stand before the carcass, a shadow gap between them.
        front = box(
            (0, y, depth / 2 + 0.001 + FRONT / 2),
            (width - 0.004, row_height + shelf - 0.004, FRONT),
            front_look,
        )
        at = np.array([0, y, depth / 2 + 0.001 + FRONT])
        handle, reach = _handle(np.random.default_rng(handle_seed), at, width, row_height)
        if row == moving_row:
            box_height = row_height - 2 * GAP - 0.01
            center = (0, y - 0.005, depth / 2 - inner_d / 2)
            drawer = [front, *handle, *tray(center, (inner_w, box_height, inner_d), 0.006, c.WOODS[1], "+y")]
            head = at + np.array([0, 0, reach])
            inside = np.array([0, y - 0.005, depth / 2 - inner_d / 2])
        else:
            body += [front, *handle]
            body.append(box((0, y, wall / 2 + 0.001), (inner_w, row_height - 2 * GAP, inner_d), c.WOODS[1], 0.0))
    return Blueprint(
        body=body,
        moving=drawer,
        joint_type="prismatic",
        joint_origin=(0, 0, 0),
        joint_axis=(0, 0, 1),
        limits=(0.0, min(stroke, inner_d - 0.03)),
        keypoints={
            "articulated_object_head": (head, "the middle of the drawer's handle"),
            "articulated_object_inside": (inside, "the point inside the drawer to put an object"),
        },
        object_axis="z",
    )


OBJECT_CLASS = ObjectClass("drawer", 20, "prismatic", build)

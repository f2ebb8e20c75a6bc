"""A box with a hinged lid."""

from __future__ import annotations

import numpy as np

from gensim2.assets.blueprint import Blueprint, ObjectClass
from gensim2.assets.classes import _common as c
from gensim2.assets.shapes import box, rod, tray

GAP = 0.001  # m between lid and rim


def build(rng: np.random.Generator) -> Blueprint:
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
        lid.append(
            box(
                (0, top + GAP + plate / 2, front + overhang + 0.004),
                (0.16 * width, 0.7 * plate, 0.012),
                metal,
            )
        )
    reach = front + overhang + (0.01 if tab else 0.0)
    for side in (-1, 1):
        x = side * 0.3 * width
        body.append(
            rod(
                (x - 0.015, top - 0.004, back - 0.003), (x + 0.015, top - 0.004, back - 0.003), 0.003, metal
            ).visual_only()
        )

    # As with most released boxes, the lid stands upright at joint value zero and is shut at a quarter turn below it.
    axis, shut = (-1.0, 0.0, 0.0), -np.pi / 2
    head, tail = (0, top + GAP + plate / 2, reach), (0, top + GAP, back)
    return Blueprint(
        body=body,
        moving=c.turned(lid, origin, axis, -shut),
        joint_type="revolute",
        joint_origin=origin,
        joint_axis=axis,
        limits=(shut, tilt - 0.15),
        keypoints={
            "articulated_object_head": (
                c.turned_point(head, origin, axis, -shut),
                "the midpoint of the front edge of the box lid",
            ),
            "articulated_object_tail": (
                c.turned_point(tail, origin, axis, -shut),
                "the midpoint of the hinge between the box lid and the body",
            ),
            "articulated_object_inside_base": (
                (0, top + 0.06, 0),
                "the point from which to drop an object into the box",
            ),
        },
        object_axis="x",
    )


OBJECT_CLASS = ObjectClass("box_rotate", 13, "revolute", build)

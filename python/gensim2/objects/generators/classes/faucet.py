"""A faucet with a lever on top that turns about the upright axis."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import ball, cone, path, rod

GAP = 0.001


def build(rng: np.random.Generator) -> Blueprint:
    height = c.between(rng, 0.16, 0.23)
    radius = c.between(rng, 0.018, 0.026)
    spout = c.between(rng, 0.10, 0.15)
    tube = c.between(rng, 0.009, 0.013)
    lever = c.between(rng, 0.11, 0.16)
    bar = c.between(rng, 0.006, 0.010)
    rise = c.between(rng, 0.1, 0.5)
    cap = c.between(rng, 0.020, 0.034)
    look = c.pick(rng, c.METALS)
    lever_look = look if rng.random() < 0.6 else c.pick(rng, c.METALS)
    bent = rng.random() < 0.5
    flat_tip = rng.random() < 0.5

    bottom, z = -height / 2, -0.03
    top = bottom + height
    plate = 0.012
    body = [
        cone((0, bottom, z), (0, bottom + plate, z), 2.0 * radius, 1.8 * radius, look),
        cone((0, bottom + plate, z), (0, top, z), radius, 0.92 * radius, look),
    ]
    at = bottom + c.between(rng, 0.52, 0.68) * height
    if bent:
        points = [
            np.array([0, at, z]),
            np.array([0, at + 0.015, z + 0.5 * spout]),
            np.array([0, at + 0.006, z + spout]),
        ]
    else:
        points = [np.array([0, at, z]), np.array([0, at + 0.01, z + spout])]
    body += path(points, tube, look)
    end = points[-1]
    body.append(cone(end, end - np.array([0, 0.028, 0]), tube, 1.1 * tube, look))
    body.append(ball(end, tube, look).visual_only())

    base = top + GAP
    origin = np.array([0.0, base, z])
    moving = [cone((0, base, z), (0, base + cap, z), radius, 0.8 * radius, lever_look)]
    start = np.array([0, base + 0.6 * cap, z])
    tip = start + lever * np.array([0, np.sin(rise), np.cos(rise)])
    moving += path([start, tip], bar, lever_look)
    moving.append(ball(tip, (1.6 * bar if flat_tip else 1.15 * bar, 1.15 * bar, 1.15 * bar), lever_look))
    moving.append(rod((0, base + cap, z), (0, base + cap + 0.002, z), 0.4 * radius, c.PAINTS[1]).visual_only())
    return Blueprint(
        body=body,
        moving=moving,
        joint_type="revolute",
        joint_origin=origin,
        joint_axis=(0, -1, 0),
        limits=(-1.2, 1.2),
        keypoints={
            "articulated_object_head": (tip, "the tip of the faucet's lever"),
            "articulated_object_tail": (start, "the point where the faucet's lever meets its joint"),
            "articulated_object_bottom_base": (
                (0, bottom + 0.03, z + spout),
                "the point under the faucet's spout",
            ),
        },
        object_axis="y",
    )


OBJECT_CLASS = ObjectClass("faucet", 13, "revolute", build)

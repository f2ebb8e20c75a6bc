"""Define a class of generated objects: a coffee machine with a push button on top."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import Solid, box, cone, rod, rounded_box, tube


def build(rng: np.random.Generator) -> Blueprint:
    width, depth, height = c.between(rng, 0.14, 0.19), c.between(rng, 0.17, 0.22), c.between(rng, 0.20, 0.25)
    look = c.pick(rng, (*c.PAINTS, c.STEEL, c.BLACK))
    dark = c.BLACK
    metal = c.pick(rng, (c.CHROME, c.STEEL))
    button = c.between(rng, 0.020, 0.028)
    stroke = c.between(rng, 0.014, 0.020)

    half = height / 2
    tray_h, head_h, column = 0.028, 0.075, 0.42 * depth
    front = depth / 2
    body: list[Solid] = [
        rounded_box((0, -half + tray_h / 2, 0), (width, tray_h, depth), look, 0.015),
        box((0, 0, -depth / 2 + column / 2), (width, height - 2 * 0.004, column), look, 0.006),
        rounded_box((0, half - head_h / 2, 0), (width, head_h, depth), look, 0.015),
    ]
    spout_z = -depth / 2 + column + (depth - column) / 2
    body.append(cone((0, half - head_h, spout_z), (0, half - head_h - 0.022, spout_z), 0.020, 0.012, metal))
    for i in range(6):
        x = (i - 2.5) * 0.14 * width
        bar = box((x, -half + tray_h + 0.001, spout_z), (0.006, 0.002, 0.8 * (depth - column)), dark, 0.0)
        body.append(bar.visual_only())
    cup_y = -half + tray_h + 0.002
    body += [
        part.visual_only()
        for part in tube((0, cup_y, spout_z), (0, cup_y + 0.045, spout_z), 0.020, 0.027, 0.002, c.WHITE, 12, 0.003)
    ]
    body.append(box((0, half - 0.035, front + 0.001), (0.5 * width, 0.03, 0.002), c.DISPLAY, 0.0).visual_only())
    for side in (-1, 1):
        at = np.array([side * 0.36 * width, half - 0.035, front])
        body.append(rod(at, at + np.array([0, 0, 0.010]), 0.011, metal).visual_only())
    rim = rod((0, half, 0.1 * depth), (0, half + 0.003, 0.1 * depth), button + 0.006, dark)
    body.append(rim.visual_only())
    base = half + 0.002
    moving = [
        rod(
            (0, base + stroke, 0.1 * depth), (0, base + stroke + 0.012, 0.1 * depth), button, c.pick(rng, c.PAINTS[1:])
        ),
        rod((0, base + 0.001, 0.1 * depth), (0, base + stroke, 0.1 * depth), 0.6 * button, metal).visual_only(),
    ]
    return c.sliding(
        body,
        moving,
        (0, -1, 0),
        (0.0, stroke - 0.001),
        head=((0, base + stroke + 0.012, 0.1 * depth), "the middle of the button's top"),
    )


OBJECT_CLASS = ObjectClass("coffee_machine", 2, "prismatic", build)

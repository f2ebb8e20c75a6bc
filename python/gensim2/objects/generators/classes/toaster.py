"""Define two classes of generated toasters: toasters that are pushed, and toasters whose lever is pressed down."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gensim2.core.arrays import Array
from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import Look, Solid, box, rod, rounded_box


@dataclass(frozen=True)
class Toaster:
    """Parts of a toaster with the lever up; ``lever_top`` (3,) is the middle of the lever's upper face."""

    body: list[Solid]
    lever: list[Solid]
    lever_top: Array
    stroke: float


def draw(rng: np.random.Generator) -> Toaster:
    width, height, depth = c.between(rng, 0.13, 0.18), c.between(rng, 0.13, 0.17), c.between(rng, 0.20, 0.26)
    look = c.pick(rng, (*c.PAINTS, c.STEEL, c.CHROME))
    dark = c.BLACK
    slots = int(rng.integers(1, 3))
    stroke = c.between(rng, 0.045, 0.065)
    grip = c.between(rng, 0.030, 0.045)
    foot = 0.008

    half = height / 2
    slot_w, slot_d, slot_h = 0.022, 0.72 * depth, 0.6 * height
    body: list[Solid] = []
    # The body consists of a floor below the slots, and of vertical slabs between the slots and on all sides of them.
    floor_top = half - slot_h
    body.append(rounded_box((0, (floor_top - half) / 2, 0), (width, floor_top + half, depth), look, 0.02))
    centers = [0.0] if slots == 1 else [-0.2 * width, 0.2 * width]
    edges = [-width / 2, *[v for x in centers for v in (x - slot_w / 2, x + slot_w / 2)], width / 2]
    for left, right in zip(edges[::2], edges[1::2], strict=True):
        body.append(box(((left + right) / 2, half - slot_h / 2, 0), (right - left, slot_h, slot_d), look, 0.003))
    for sz in (-1, 1):
        z = sz * (slot_d / 2 + (depth - slot_d) / 4)
        body.append(rounded_box((0, half - slot_h / 2, z), (width, slot_h, (depth - slot_d) / 2), look, 0.012))
    body += c.feet(width, depth, -half, foot, 0.010)
    front = depth / 2
    body.append(box((0, 0.05 * height, front), (0.014, 0.62 * height, 0.002), dark, 0.0).visual_only())
    knob = np.array([0.3 * width, -0.28 * height, front])
    body.append(rod(knob, knob + np.array([0, 0, 0.012]), 0.014, dark).visual_only())
    start = 0.26 * height
    thick = 0.014
    reach = 0.028
    lever = [rounded_box((0, start, front + 0.002 + reach / 2), (grip, thick, reach), dark, 0.006)]
    band = (width + 0.0012, 0.005, depth + 0.0012)
    body.append(rounded_box((0, floor_top, 0), band, c.STEEL if look.metallic == 0 else dark, 0.0205).visual_only())
    mark = knob + np.array([0, 0.006, 0.0125])
    body.append(box(mark, (0.0022, 0.012, 0.001), c.WHITE, 0.0).visual_only())
    # The bread moves with the lever.
    crust = Look((0.72, 0.47, 0.22, 1), 0.0, 0.9)
    low, high = floor_top + stroke + 0.004, half + 0.028
    for x in centers:
        deep = 0.86 * slot_d
        lever.append(box((x, (low + high) / 2 - 0.006, 0), (0.014, high - low - 0.012, deep), crust).visual_only())
        loaf = rounded_box((x, high - 0.014, 0), (0.014, 0.028, 1.04 * deep), crust, 0.012, axis=0)
        lever.append(loaf.visual_only())
    return Toaster(body, lever, np.array([0, start + thick / 2, front + 0.002 + 0.6 * reach]), stroke)


def move(rng: np.random.Generator) -> Blueprint:
    toaster = draw(rng)
    _, high = c.bounds(toaster.body)
    head = (0.0, high[1] - 0.012, high[2])
    return c.pushed(toaster.body + toaster.lever, 0.12, "the middle of the upper edge of the toaster's front", head)


MOVE = ObjectClass("toaster_move", 10, "prismatic", move)


def press(rng: np.random.Generator) -> Blueprint:
    toaster = draw(rng)
    return c.sliding(
        toaster.body,
        toaster.lever,
        (0, -1, 0),
        (0.0, toaster.stroke),
        head=(toaster.lever_top, "the middle of the toaster's lever"),
    )


PRESS = ObjectClass("toaster_press", 10, "prismatic", press)

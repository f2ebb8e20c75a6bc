"""Define two classes of kitchen appliances with a door that folds down: a dishwasher and an oven."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import Look, Solid, Vec3, box, rod, tray

GAP = 0.0015


@dataclass(frozen=True)
class FoldDown:
    """Dimensions of an appliance: outer size, plinth below the door, panel above it, wall and door thickness (m)."""

    width: float
    height: float
    depth: float
    plinth: float
    panel: float
    wall: float
    door: float

    @property
    def front(self) -> float:
        return self.depth / 2

    @property
    def opening(self) -> tuple[float, float]:
        """Lower and upper y of the cavity, m."""
        return -self.height / 2 + self.plinth, self.height / 2 - self.panel


def carcass(size: FoldDown, look: Look) -> list[Solid]:
    """Return the appliance's body, which is open at the front, with a solid plinth and panel."""
    low, high = size.opening
    middle = (low + high) / 2
    parts = tray((0, middle, 0), (size.width, high - low, size.depth), size.wall, look, "+z")
    if size.panel > 0:
        parts.append(box((0, size.height / 2 - size.panel / 2, 0), (size.width, size.panel, size.depth), look, 0.003))
    plinth = size.plinth - 0.006
    foot = -size.height / 2 + plinth / 2 + 0.006
    parts.append(box((0, foot, -0.01), (0.94 * size.width, plinth, size.depth - 0.02), c.BLACK))
    return parts + c.feet(size.width, size.depth, -size.height / 2 + 0.006, 0.006, 0.010)


def fold_down_door(
    size: FoldDown, look: Look, metal: Look, rng: np.random.Generator, window: bool
) -> tuple[list[Solid], Vec3, np.ndarray]:
    """Generate an appliance's door that is hinged at its lower edge.

    Return three values: the parts of the door, a point on the hinge axis, and the middle of the door's handle.
    """
    low, high = size.opening
    z = size.front + GAP
    span, tall = size.width - 0.004, high - low - 0.004
    middle = (low + high) / 2
    parts = [box((0, middle, z + size.door / 2), (span, tall, size.door), look, 0.003)]
    if window:
        pane = (0.7 * span, 0.55 * tall, 0.002)
        parts.append(box((0, middle - 0.05 * tall, z + size.door), pane, c.GLASS, 0.0).visual_only())
    reach = c.between(rng, 0.028, 0.040)
    at = np.array([0.0, high - 0.16 * tall, z + size.door + reach])
    length = c.between(rng, 0.5, 0.75) * size.width
    if rng.random() < 0.5:
        parts += c.bar_handle(at, length, "x", reach, 0.006, metal)
    else:
        parts += c.flat_handle(at, length, "x", reach, 0.012, metal)
    return parts, (0, low + 0.002, z), at


def fold_down(body: list[Solid], door: list[Solid], hinge: Vec3, head: np.ndarray, what: str) -> Blueprint:
    """Return the blueprint of an appliance whose door folds down by a quarter turn."""
    return c.hinged(
        body,
        door,
        hinge,
        (1, 0, 0),
        (0.0, np.pi / 2 - 0.03),
        head=(head, f"the middle of the handle of the {what}'s door"),
    )


def dishwasher(rng: np.random.Generator) -> Blueprint:
    size = FoldDown(
        width=c.between(rng, 0.26, 0.32),
        height=c.between(rng, 0.28, 0.33),
        depth=c.between(rng, 0.23, 0.28),
        plinth=c.between(rng, 0.055, 0.070),
        panel=c.between(rng, 0.020, 0.030),
        wall=c.between(rng, 0.008, 0.014),
        door=c.between(rng, 0.018, 0.026),
    )
    look = c.pick(rng, (c.WHITE, c.STEEL, c.PAINTS[5], c.PAINTS[0]))
    metal = c.pick(rng, (c.CHROME, c.STEEL))

    body = carcass(size, look)
    low, high = size.opening
    inner = size.width - 2 * size.wall
    for level in (0.18, 0.58):
        y = low + level * (high - low)
        body.append(box((0, y, 0), (inner, 0.003, 0.84 * size.depth), c.STEEL, 0.0).visual_only())
        for k in range(7):
            x = (k - 3) * inner / 8
            at = np.array([x, y + 0.028, 0.0])
            body.append(rod(at, at + np.array([0.003, 0, 0]), 0.030, c.WHITE).visual_only())
    door, hinge, head = fold_down_door(size, look, metal, rng, window=False)
    z = size.front + GAP + size.door
    door.append(box((0, high - 0.022, z), (0.9 * size.width, 0.024, 0.002), c.BLACK, 0.0).visual_only())
    door.append(box((0.3 * size.width, high - 0.022, z + 0.001), (0.04, 0.010, 0.002), c.DISPLAY, 0.0).visual_only())
    return fold_down(body, door, hinge, head, "dishwasher")


DISHWASHER = ObjectClass("dishwasher", 3, "revolute", dishwasher)


def oven(rng: np.random.Generator) -> Blueprint:
    size = FoldDown(
        width=c.between(rng, 0.28, 0.36),
        height=c.between(rng, 0.28, 0.34),
        depth=c.between(rng, 0.22, 0.27),
        plinth=c.between(rng, 0.060, 0.075),
        panel=c.between(rng, 0.045, 0.060),
        wall=c.between(rng, 0.010, 0.016),
        door=c.between(rng, 0.014, 0.020),
    )
    look = c.pick(rng, (c.WHITE, c.STEEL, c.BLACK, *c.PAINTS[1:4]))
    metal = c.pick(rng, (c.CHROME, c.STEEL))
    knobs = int(rng.integers(3, 6))
    plates = rng.random() < 0.7

    body = carcass(size, look)
    y = size.height / 2 - size.panel / 2
    for k in range(knobs):
        at = np.array([((k + 0.5) / knobs - 0.5) * 0.8 * size.width, y, size.front])
        body.append(rod(at, at + np.array([0, 0, 0.014]), 0.012, metal).visual_only())
        body.append(box(at + np.array([0, 0.006, 0.014]), (0.002, 0.010, 0.001), c.BLACK, 0.0).visual_only())
    if plates:
        for sx in (-1, 1):
            for sz, radius in ((-1, 0.038), (1, 0.046)):
                at = np.array([sx * 0.24 * size.width, size.height / 2, sz * 0.24 * size.depth])
                body.append(rod(at, at + np.array([0, 0.002, 0]), radius, c.BLACK).visual_only())
    low, high = size.opening
    for level in (0.35, 0.65):
        rack = (size.width - 2 * size.wall, 0.003, 0.8 * size.depth)
        body.append(box((0, low + level * (high - low), -0.02), rack, c.STEEL, 0.0).visual_only())
    door, hinge, head = fold_down_door(size, look, metal, rng, window=True)
    return fold_down(body, door, hinge, head, "oven")


OVEN = ObjectClass("oven", 4, "revolute", oven)

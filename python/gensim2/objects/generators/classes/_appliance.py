"""Kitchen appliances with a door that folds down."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import Look, Solid, Vec3, box, tray

GAP = 0.0015


@dataclass(frozen=True)
class FoldDown:
    """Measures of an appliance: outer size, plinth under the door, panel above it, wall and door thickness (m)."""

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
        """Lower and upper y of the cavity's compartment."""
        return -self.height / 2 + self.plinth, self.height / 2 - self.panel


def carcass(size: FoldDown, look: Look) -> list[Solid]:
    """The body with its cavity open to the front, plinth and panel solid."""
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
    """A door hinged at its lower edge with a bar handle near its upper one: parts, hinge, middle of the handle."""
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
    """The blueprint of an appliance whose door folds down by a quarter turn."""
    return Blueprint(
        body=body,
        moving=door,
        joint_type="revolute",
        joint_origin=hinge,
        joint_axis=(1, 0, 0),
        limits=(0.0, np.pi / 2 - 0.03),
        keypoints={"articulated_object_head": (head, f"the middle of the handle of the {what}'s door")},
        object_axis="x",
    )

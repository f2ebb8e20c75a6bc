"""Parts of everything with a drawer: handles, and the joint that it slides along."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import Look, Solid, ball, box, rod

GAP = 0.002  # m around the sliding drawer
FRONT = 0.012  # m thickness of a drawer's front
WALL = 0.012  # m thickness of a table's aprons, and of a sideboard's boards


def knob(at: np.ndarray, end: np.ndarray, radius: float, look: Look) -> list[Solid]:
    """A round knob of ``radius`` at ``end``, on a stem from ``at``."""
    return [rod(at, end, 0.5 * radius, look, 8), ball(end, (radius, radius, 0.7 * radius), look)]


def sliding(body: list[Solid], drawer: list[Solid], head: np.ndarray, inside: np.ndarray, stroke: float) -> Blueprint:
    """A drawer that slides ``stroke`` metres towards the front, taken at ``head``."""
    return Blueprint(
        body=body,
        moving=drawer,
        joint_type="prismatic",
        joint_origin=(0, 0, 0),
        joint_axis=(0, 0, 1),
        limits=(0.0, stroke),
        keypoints={
            "articulated_object_head": (head, "the middle of the drawer's handle"),
            "articulated_object_inside": (inside, "the point inside the drawer to put an object"),
        },
        object_axis="z",
    )


def small_handle(rng: np.random.Generator, at: np.ndarray, width: float) -> tuple[list[Solid], np.ndarray]:
    """A knob, two of them, a tab or a bar in front of ``at``, and the middle of the one to take."""
    look = c.pick(rng, c.METALS)
    kind = int(rng.integers(4))
    reach, radius = c.between(rng, 0.018, 0.032), c.between(rng, 0.009, 0.015)
    middle = at + np.array([0, 0, reach])
    if kind == 0:
        length = min(c.between(rng, 0.06, 0.10), 0.5 * width)
        return c.bar_handle(middle, length, "x", reach, c.between(rng, 0.004, 0.006), look), middle
    if kind == 1:
        size = (c.between(rng, 0.02, 0.05), c.between(rng, 0.008, 0.014), reach)
        return [box(at + np.array([0, 0, reach / 2]), size, look)], middle
    aside = 0.0 if kind == 2 else c.between(rng, 0.2, 0.32) * width
    parts: list[Solid] = []
    for x in sorted({aside, -aside}):
        there = np.array([x, 0, 0])
        parts += knob(at + there, middle + there, radius, look)
    return parts, middle + np.array([aside, 0, 0])

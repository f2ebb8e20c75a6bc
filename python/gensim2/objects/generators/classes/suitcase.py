"""Define suitcases that lie flat. Some are pushed, and the lids of others are opened and closed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gensim2.core.arrays import Array
from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import Solid, box, path, rounded_box, tray


@dataclass(frozen=True)
class Suitcase:
    """Parts of a closed suitcase. ``hinge`` and ``edge`` (3,) are midpoints of the lower and upper edge of the lid."""

    shell: list[Solid]
    lid: list[Solid]
    hinge: Array
    edge: Array
    grip: Array


def draw(rng: np.random.Generator) -> Suitcase:
    """Generate the parts of a random closed suitcase."""
    width, height = c.between(rng, 0.26, 0.34), c.between(rng, 0.18, 0.23)
    deep, shallow = c.between(rng, 0.045, 0.07), c.between(rng, 0.025, 0.045)
    wall = c.between(rng, 0.005, 0.007)
    look = c.pick(rng, c.PAINTS)
    band = c.pick(rng, (*c.WOODS, c.BLACK))
    metal = c.pick(rng, c.METALS)
    overhang = c.between(rng, 0.008, 0.014)

    gap = 0.001
    shell = tray((0, 0, -deep / 2), (width, height, deep), wall, look, "+z")
    lid = tray((0, 0, gap + shallow / 2), (width, height, shallow), wall, look, "-z")
    top = height / 2
    lip = gap + 0.006
    lid.append(box((0, top + overhang / 2, lip), (0.35 * width, overhang, 0.010), metal))
    for side in (-1, 1):
        x = side * 0.32 * width
        shell.append(box((x, 0, -deep - 0.0005), (0.03, height, 0.002), band, 0.0).visual_only())
        lid.append(box((x, 0, gap + shallow + 0.0005), (0.03, height, 0.002), band, 0.0).visual_only())
        shell.append(box((x, top + 0.002, -0.012), (0.022, 0.004, 0.018), metal).visual_only())
    for sx in (-1, 1):
        for sy in (-1, 1):
            x, y = sx * (width / 2 - 0.014), sy * (height / 2 - 0.014)
            cap = (0.031, 0.031, 0.0065)
            lid.append(rounded_box((x, y, gap + shallow - 0.0020), cap, band, 0.012, 2).visual_only())
            shell.append(rounded_box((x, y, -deep + 0.0020), cap, band, 0.012, 2).visual_only())
    for s in (-1, 1):
        shell.append(box((0, s * height / 2, -0.0025), (width, 0.0015, 0.004), metal, 0.0).visual_only())
        shell.append(box((s * width / 2, 0, -0.0025), (0.0015, height, 0.004), metal, 0.0).visual_only())
    z = -deep / 2
    handle = [np.array([x, y, z]) for x, y in ((-0.05, top), (-0.04, top + 0.026), (0.04, top + 0.026), (0.05, top))]
    shell += path(handle, 0.005, c.BLACK, 8)
    hinge = np.array([0, -top, gap])
    return Suitcase(shell, lid, hinge, np.array([0, top + overhang, lip]), np.array([0, top + 0.026, z]))


def move(rng: np.random.Generator) -> Blueprint:
    case = draw(rng)
    pushed = c.pushed(case.shell + case.lid, 0.12, "the midpoint of the near edge of the suitcase", case.edge)
    # The suitcase lies on its back with its top towards the robot. The direction away from the robot is -y of the
    # model.
    return replace(pushed, joint_axis=(0, -1, 0))


def with_its_lid_up(rng: np.random.Generator) -> Blueprint:
    """Generate a random open suitcase whose lid stands upright on the side away from the robot."""
    case = draw(rng)
    lid = c.turned(case.lid, case.hinge, (1, 0, 0), c.between(rng, 0.9, 1.9))
    near = (0.0, -float(case.hinge[1]), float(case.grip[2]))
    pushed = c.pushed(case.shell + lid, 0.12, "the midpoint of the near edge of the suitcase", near)
    return replace(pushed, joint_axis=(0, -1, 0))


MOVE = ObjectClass("suitcase_move", 3, "prismatic", move, (with_its_lid_up,))


def rotate(rng: np.random.Generator) -> Blueprint:
    case = draw(rng)
    return c.hinged(
        case.shell,
        case.lid,
        case.hinge,
        (1, 0, 0),
        (0.0, 1.5),
        head=(case.edge, "the midpoint of the near edge of the suitcase's lid"),
        tail=(case.hinge, "the midpoint of the hinge between the suitcase's lid and body"),
    )


ROTATE = ObjectClass("suitcase_rotate", 4, "revolute", rotate)

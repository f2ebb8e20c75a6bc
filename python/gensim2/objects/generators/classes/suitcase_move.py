"""A suitcase that lies flat, shut or with its lid up, and is pushed across the table."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.generators.classes import _suitcase


def build(rng: np.random.Generator) -> Blueprint:
    case = _suitcase.draw(rng)
    pushed = c.pushed(case.shell + case.lid, 0.12, "the midpoint of the near edge of the suitcase", case.edge)
    # It lies on its back, its top towards the robot: away is down in the model frame.
    return replace(pushed, joint_axis=(0, -1, 0), object_axis="y")


def with_its_lid_up(rng: np.random.Generator) -> Blueprint:
    """One that stands open, its lid on the far side."""
    case = _suitcase.draw(rng)
    lid = c.turned(case.lid, case.hinge, (1, 0, 0), c.between(rng, 0.9, 1.9))
    near = (0.0, -float(case.hinge[1]), float(case.grip[2]))
    pushed = c.pushed(case.shell + lid, 0.12, "the midpoint of the near edge of the suitcase", near)
    return replace(pushed, joint_axis=(0, -1, 0), object_axis="y")


OBJECT_CLASS = ObjectClass("suitcase_move", 3, "prismatic", build, (with_its_lid_up,))

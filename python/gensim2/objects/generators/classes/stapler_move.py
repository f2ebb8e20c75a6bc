"""A stapler that is pushed across the table."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.generators.classes import _stapler


def build(rng: np.random.Generator) -> Blueprint:
    stapler = _stapler.draw(rng)
    return c.pushed(stapler.base + stapler.arm, 0.2, "the tip of the stapler", stapler.tip)


OBJECT_CLASS = ObjectClass("stapler_move", 3, "prismatic", build)

"""A box that is pushed across the table."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.generators.classes import box_rotate


def build(rng: np.random.Generator) -> Blueprint:
    whole = box_rotate.build(rng)
    low, high = c.bounds(whole.body)
    head = (0.0, 0.3 * low[1] + 0.7 * high[1], high[2])
    return c.pushed(c.at(whole, whole.limits[0]), 0.2, "the middle of the box's front, near its upper edge", head)


OBJECT_CLASS = ObjectClass("box_move", 1, "prismatic", build)

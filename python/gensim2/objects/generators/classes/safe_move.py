"""A safe that is pushed across the table."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.generators.classes import safe_rotate


def build(rng: np.random.Generator) -> Blueprint:
    whole = safe_rotate.build(rng)
    low, high = c.bounds(whole.moving[:1])  # the door without its handle
    head = (0.0, 0.25 * low[1] + 0.75 * high[1], high[2])
    return c.pushed(c.at(whole, whole.limits[0]), 0.25, "the middle of the safe's front, near its upper edge", head)


OBJECT_CLASS = ObjectClass("safe_move", 2, "prismatic", build)

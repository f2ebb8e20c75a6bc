"""A laptop that is pushed across the table."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.generators.classes import laptop_rotate


def build(rng: np.random.Generator) -> Blueprint:
    whole = laptop_rotate.build(rng)
    low, high = c.bounds(whole.body)
    head = (0.0, 0.3 * low[1] + 0.7 * high[1], high[2])
    # Half of them are pushed with the screen up, as one makes room on a desk.
    share = 0.9 if c.extra(rng).random() < 0.7 else 0.0
    screen = whole.limits[0] + share * (whole.limits[1] - whole.limits[0])
    return c.pushed(c.at(whole, screen), 0.25, "the middle of the laptop's near edge", head)


OBJECT_CLASS = ObjectClass("laptop_move", 3, "prismatic", build)

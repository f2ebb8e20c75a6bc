"""A toaster that is pushed across the table."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.generators.classes import _toaster


def build(rng: np.random.Generator) -> Blueprint:
    toaster = _toaster.draw(rng)
    _, high = c.bounds(toaster.body)
    head = (0.0, high[1] - 0.012, high[2])
    return c.pushed(toaster.body + toaster.lever, 0.12, "the middle of the upper edge of the toaster's front", head)


OBJECT_CLASS = ObjectClass("toaster_move", 10, "prismatic", build)

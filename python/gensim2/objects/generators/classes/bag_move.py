"""A bag that is pushed across the table."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _bag
from gensim2.objects.generators.classes import _common as c


def build(rng: np.random.Generator) -> Blueprint:
    bag = _bag.draw(rng)
    return c.pushed(bag.body + bag.strap, 0.12, "the middle of the bag's front, near its upper edge", bag.front)


OBJECT_CLASS = ObjectClass("bag_move", 2, "prismatic", build)

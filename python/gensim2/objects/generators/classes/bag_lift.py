"""A bag that is lifted by its strap."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _bag
from gensim2.objects.generators.classes import _common as c


def build(rng: np.random.Generator) -> Blueprint:
    bag = _bag.draw(rng)
    return c.lifted(bag.body + bag.strap, bag.top, "the middle of the bag's strap")


OBJECT_CLASS = ObjectClass("bag_lift", 2, "prismatic", build)

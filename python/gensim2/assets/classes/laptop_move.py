"""A laptop that is pushed across the table."""

from __future__ import annotations

import numpy as np

from gensim2.assets.blueprint import Blueprint, ObjectClass
from gensim2.assets.classes import _common as c
from gensim2.assets.classes import laptop_rotate


def build(rng: np.random.Generator) -> Blueprint:
    whole = laptop_rotate.build(rng)
    return c.pushed(c.at(whole, whole.limits[0]), 0.25, "the middle of the laptop's near edge")


OBJECT_CLASS = ObjectClass("laptop_move", 3, "prismatic", build)

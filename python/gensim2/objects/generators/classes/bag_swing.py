"""A bag whose strap swings."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _bag


def build(rng: np.random.Generator) -> Blueprint:
    bag = _bag.draw(rng)
    return Blueprint(
        body=bag.body,
        moving=bag.strap,
        joint_type="revolute",
        joint_origin=bag.hinge,
        joint_axis=(-1, 0, 0),
        limits=(-1.3, 1.3),
        keypoints={"articulated_object_head": (bag.top, "the middle of the bag's strap")},
        object_axis="x",
    )


OBJECT_CLASS = ObjectClass("bag_swing", 2, "revolute", build)

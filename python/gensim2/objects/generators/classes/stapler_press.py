"""A stapler whose arm is pressed down."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _stapler


def build(rng: np.random.Generator) -> Blueprint:
    stapler = _stapler.draw(rng)
    return Blueprint(
        body=stapler.base,
        moving=stapler.arm,
        joint_type="revolute",
        joint_origin=stapler.hinge,
        joint_axis=(-1, 0, 0),
        limits=(-0.12, 0.3),
        keypoints={"articulated_object_head": (stapler.tip, "the tip of the stapler's arm")},
        object_axis="x",
    )


OBJECT_CLASS = ObjectClass("stapler_press", 3, "revolute", build)

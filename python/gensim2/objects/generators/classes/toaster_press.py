"""A toaster whose lever is pressed down."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _toaster


def build(rng: np.random.Generator) -> Blueprint:
    toaster = _toaster.draw(rng)
    return Blueprint(
        body=toaster.body,
        moving=toaster.lever,
        joint_type="prismatic",
        joint_origin=(0, 0, 0),
        joint_axis=(0, -1, 0),
        limits=(0.0, toaster.stroke),
        keypoints={"articulated_object_head": (toaster.lever_top, "the middle of the toaster's lever")},
        object_axis="y",
    )


OBJECT_CLASS = ObjectClass("toaster_press", 10, "prismatic", build)

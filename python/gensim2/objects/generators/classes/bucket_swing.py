"""A bucket whose handle swings."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _bucket


def _swinging(bucket: _bucket.Bucket) -> Blueprint:
    return Blueprint(
        body=bucket.body,
        moving=bucket.handle,
        joint_type="revolute",
        joint_origin=bucket.hinge,
        joint_axis=(-1, 0, 0),
        limits=(-1.45, 1.45),
        keypoints={"articulated_object_head": (bucket.top, "the middle of the bucket's handle")},
        object_axis="x",
    )


def build(rng: np.random.Generator) -> Blueprint:
    return _swinging(_bucket.draw(rng))


def pail(rng: np.random.Generator) -> Blueprint:
    """A pail, whose wire is hinged below its rim."""
    return _swinging(_bucket.pail(rng))


OBJECT_CLASS = ObjectClass("bucket_swing", 26, "revolute", build, (pail,))

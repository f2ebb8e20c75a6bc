"""A bucket that is lifted by its handle."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _bucket
from gensim2.objects.generators.classes import _common as c


def build(rng: np.random.Generator) -> Blueprint:
    bucket = _bucket.draw(rng)
    above = bucket.top + np.array([0, 0.05, 0.05])
    extra = {"articulated_object_above": (above, "the point above the bucket from which to drop an object into it")}
    return c.lifted(bucket.body + bucket.handle, bucket.top, "the middle of the bucket's handle", extra)


OBJECT_CLASS = ObjectClass("bucket_lift", 5, "prismatic", build)

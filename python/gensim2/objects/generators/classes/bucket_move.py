"""A bucket that is pushed across the table."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _bucket
from gensim2.objects.generators.classes import _common as c


def build(rng: np.random.Generator) -> Blueprint:
    bucket = _bucket.draw(rng)
    folded = c.turned(bucket.handle, bucket.hinge, (-1, 0, 0), 1.3)
    return c.pushed(bucket.body + folded, 0.25, "the nearest point of the bucket's rim", bucket.front)


OBJECT_CLASS = ObjectClass("bucket_move", 2, "prismatic", build)

"""A suitcase that lies flat and opens."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _suitcase


def build(rng: np.random.Generator) -> Blueprint:
    case = _suitcase.draw(rng)
    return Blueprint(
        body=case.shell,
        moving=case.lid,
        joint_type="revolute",
        joint_origin=case.hinge,
        joint_axis=(1, 0, 0),
        limits=(0.0, 1.5),
        keypoints={
            "articulated_object_head": (case.edge, "the midpoint of the near edge of the suitcase's lid"),
            "articulated_object_tail": (case.hinge, "the midpoint of the hinge between the suitcase's lid and body"),
        },
        object_axis="x",
    )


OBJECT_CLASS = ObjectClass("suitcase_rotate", 4, "revolute", build)

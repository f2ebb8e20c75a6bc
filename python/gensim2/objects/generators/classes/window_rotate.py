"""A window with a pane that opens towards the robot."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.generators.classes import _window as w


def build(rng: np.random.Generator) -> Blueprint:
    frame = w.draw(rng)
    body = w.surround(frame)
    z = frame.deep / 2 + 0.0015 + frame.sash / 2
    span, tall = frame.width + 0.6 * frame.post, frame.height + 0.6 * frame.post
    pane = w.sash((0, 0, z), span, tall, frame)
    left = -span / 2
    at = np.array([0.5 * span - 0.012, 0.0, z + frame.sash / 2 + 0.030])
    pane += c.bar_handle(at, 0.09, "y", 0.030, 0.005, frame.metal)
    hinge = np.array([left, 0.0, z - frame.sash / 2])
    return Blueprint(
        body=body,
        moving=pane,
        joint_type="revolute",
        joint_origin=hinge,
        joint_axis=(0, -1, 0),
        limits=(0.0, 1.4),
        keypoints={
            "articulated_object_head": (at, "the middle of the handle at the free edge of the window"),
            "articulated_object_tail": (
                hinge + np.array([0.004, 0, frame.sash / 2]),
                "the midpoint of the joint between the window and its frame",
            ),
        },
        object_axis="y",
    )


OBJECT_CLASS = ObjectClass("window_rotate", 2, "revolute", build)

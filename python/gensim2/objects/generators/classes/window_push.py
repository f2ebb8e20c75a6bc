"""A window with a pane that slides sideways."""

from __future__ import annotations

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.generators.classes import _window as w
from gensim2.objects.shapes import box


def build(rng: np.random.Generator) -> Blueprint:
    frame = w.draw(rng)
    body = w.surround(frame)
    half = frame.width / 2
    # One sash fixed at the right, towards the back; the other slides in front of it, from the left.
    z_fixed, z = -0.6 * frame.sash, 0.6 * frame.sash
    tall = frame.height - 0.006
    body += w.sash((half / 2, 0, z_fixed), half, frame.height, frame)
    pane = w.sash((-half / 2 + 0.004, 0, z), half, tall, frame)
    at = np.array([-0.014, 0.0, z + frame.sash / 2 + 0.032])
    pane += c.bar_handle(at, 0.09, "y", 0.032, 0.006, frame.metal)
    for s in (-1, 1):
        track = (0, s * (frame.height / 2 + 0.001), frame.deep / 2 + 0.001)
        body.append(box(track, (frame.width, 0.004, 0.002), frame.metal, 0.0).visual_only())
    return Blueprint(
        body=body,
        moving=pane,
        joint_type="prismatic",
        joint_origin=(0, 0, 0),
        joint_axis=(1, 0, 0),
        limits=(0.0, half - 0.012),
        keypoints={"articulated_object_head": (at, "the middle of the handle by which the window slides")},
        object_axis="x",
    )


OBJECT_CLASS = ObjectClass("window_push", 2, "prismatic", build)

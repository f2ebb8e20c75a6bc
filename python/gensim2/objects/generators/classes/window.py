"""Define a class of generated objects: a framed window whose pane slides sideways or opens towards the robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gensim2.objects.generators.blueprint import Blueprint, ObjectClass
from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import Look, Solid, Vec3, box


@dataclass(frozen=True)
class WindowFrame:
    """Dimensions of a window (m): inner size, frame bars and sash.

    The class also has the materials of the frame and the metal parts.
    """

    width: float
    height: float
    post: float
    deep: float
    sash: float
    look: Look
    metal: Look


def draw(rng: np.random.Generator) -> WindowFrame:
    return WindowFrame(
        width=c.between(rng, 0.24, 0.32),
        height=c.between(rng, 0.22, 0.28),
        post=c.between(rng, 0.020, 0.028),
        deep=c.between(rng, 0.036, 0.050),
        sash=c.between(rng, 0.012, 0.016),
        look=c.pick(rng, (c.WHITE, *c.WOODS, *c.PAINTS[:4])),
        metal=c.pick(rng, c.METALS),
    )


def surround(frame: WindowFrame) -> list[Solid]:
    w, h, p = frame.width, frame.height, frame.post
    parts = [box((s * (w + p) / 2, 0, 0), (p, h + 2 * p, frame.deep), frame.look) for s in (-1, 1)]
    parts += [box((0, s * (h + p) / 2, 0), (w, p, frame.deep), frame.look) for s in (-1, 1)]
    sill = -h / 2 - p
    parts.append(box((0, sill - 0.02, 0), (w + 2 * p + 0.04, 0.04, 0.14), frame.look, 0.004))
    return parts


def sash(center: Vec3, width: float, height: float, frame: WindowFrame) -> list[Solid]:
    """Return the sash of a window: four rails, a pane, and a vertical bar without a collision shape."""
    at = np.asarray(center, float)
    rail = 0.018
    x, y = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    parts = []
    for s in (-1, 1):
        parts.append(box(at + s * (width - rail) / 2 * x, (rail, height, frame.sash), frame.look))
        parts.append(box(at + s * (height - rail) / 2 * y, (width - 2 * rail, rail, frame.sash), frame.look))
    glass = Look((0.60, 0.75, 0.85, 0.35), 0.0, 0.05)
    parts.append(box(at, (width - 2 * rail, height - 2 * rail, 0.4 * frame.sash), glass, 0.0))
    parts.append(box(at, (0.008, height - 2 * rail, 0.7 * frame.sash), frame.look, 0.0).visual_only())
    return parts


def push(rng: np.random.Generator) -> Blueprint:
    frame = draw(rng)
    body = surround(frame)
    half = frame.width / 2
    # The left sash slides in front of the right sash, which is fixed.
    z_fixed, z = -0.6 * frame.sash, 0.6 * frame.sash
    tall = frame.height - 0.006
    body += sash((half / 2, 0, z_fixed), half, frame.height, frame)
    pane = sash((-half / 2 + 0.004, 0, z), half, tall, frame)
    at = np.array([-0.014, 0.0, z + frame.sash / 2 + 0.032])
    pane += c.bar_handle(at, 0.09, "y", 0.032, 0.006, frame.metal)
    for s in (-1, 1):
        track = (0, s * (frame.height / 2 + 0.001), frame.deep / 2 + 0.001)
        body.append(box(track, (frame.width, 0.004, 0.002), frame.metal, 0.0).visual_only())
    return c.sliding(
        body, pane, (1, 0, 0), (0.0, half - 0.012), head=(at, "the middle of the handle by which the window slides")
    )


PUSH = ObjectClass("window_push", 2, "prismatic", push)


def rotate(rng: np.random.Generator) -> Blueprint:
    frame = draw(rng)
    body = surround(frame)
    z = frame.deep / 2 + 0.0015 + frame.sash / 2
    span, tall = frame.width + 0.6 * frame.post, frame.height + 0.6 * frame.post
    pane = sash((0, 0, z), span, tall, frame)
    left = -span / 2
    at = np.array([0.5 * span - 0.012, 0.0, z + frame.sash / 2 + 0.030])
    pane += c.bar_handle(at, 0.09, "y", 0.030, 0.005, frame.metal)
    hinge = np.array([left, 0.0, z - frame.sash / 2])
    return c.hinged(
        body,
        pane,
        hinge,
        (0, -1, 0),
        (0.0, 1.4),
        head=(at, "the middle of the handle at the free edge of the window"),
        tail=(
            hinge + np.array([0.004, 0, frame.sash / 2]),
            "the midpoint of the joint between the window and its frame",
        ),
    )


ROTATE = ObjectClass("window_rotate", 2, "revolute", rotate)

"""Parts that windows share: a standing frame and a glazed sash."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gensim2.objects.generators.classes import _common as c
from gensim2.objects.shapes import Look, Solid, Vec3, box


@dataclass(frozen=True)
class Frame:
    """Clear width and height, section of the frame, thickness of a sash (m), and looks."""

    width: float
    height: float
    post: float
    deep: float
    sash: float
    look: Look
    metal: Look


def draw(rng: np.random.Generator) -> Frame:
    """One frame."""
    return Frame(
        width=c.between(rng, 0.24, 0.32),
        height=c.between(rng, 0.22, 0.28),
        post=c.between(rng, 0.020, 0.028),
        deep=c.between(rng, 0.036, 0.050),
        sash=c.between(rng, 0.012, 0.016),
        look=c.pick(rng, (c.WHITE, *c.WOODS, *c.PAINTS[:4])),
        metal=c.pick(rng, c.METALS),
    )


def surround(frame: Frame) -> list[Solid]:
    """Four bars on a foot."""
    w, h, p = frame.width, frame.height, frame.post
    parts = [box((s * (w + p) / 2, 0, 0), (p, h + 2 * p, frame.deep), frame.look) for s in (-1, 1)]
    parts += [box((0, s * (h + p) / 2, 0), (w, p, frame.deep), frame.look) for s in (-1, 1)]
    sill = -h / 2 - p
    parts.append(box((0, sill - 0.02, 0), (w + 2 * p + 0.04, 0.04, 0.14), frame.look, 0.004))
    return parts


def sash(center: Vec3, width: float, height: float, frame: Frame) -> list[Solid]:
    """A glazed sash: four rails around a pane, a glazing bar to look at."""
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

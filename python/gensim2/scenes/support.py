"""Standing an object on or in another one."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from gensim2.objects.meshwork.convexes import Block, depth_inside, surface_samples
from gensim2.scenes.footprint import hulls_in_root

if TYPE_CHECKING:
    from gensim2.scenes.initial_state import PlacedObject

Array = npt.NDArray[np.float64]

CLOSE = 0.0005
"""Metres by which an object reaches into what it stands on at most; physics takes that for contact."""
STEP = 0.005
"""Metres between the heights that are tried; the first that is not free is halved off down to ``CLOSE``."""
ABOVE = 0.02
"""Metres above the measured point from which an object is lowered."""


def set_down(thing: PlacedObject, support: PlacedObject) -> PlacedObject | None:
    """``thing`` lowered over the measured point of ``support`` until it touches that.

    Args:
        thing: at rest on the table, where it is to stand in x and y.
        support: what it is to stand on or in.

    Returns:
        None where there is no room above the point, or nothing to stand on below it.
    """
    blocks = [Block.of(support.in_world(hull)) for hull in hulls_in_root(support.model, support.joint_value)]
    hulls = hulls_in_root(thing.model, thing.joint_value)
    surface = thing.in_world(np.concatenate([surface_samples(hull) for hull in hulls]))

    def is_free(height: float) -> bool:
        return bool(depth_inside(surface + np.array([0.0, 0.0, height]), blocks).max() <= CLOSE)

    free = float(support.point()[2]) + ABOVE
    if not is_free(free):
        return None
    while is_free(free - STEP):
        free -= STEP
        if free < 0.0:
            return None
    touching = free - STEP
    while free - touching > CLOSE:
        middle = (free + touching) / 2
        free, touching = (middle, touching) if is_free(middle) else (free, middle)
    return replace(thing, position=thing.position + np.array([0.0, 0.0, free]))

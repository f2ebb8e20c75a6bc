"""Define the table: its size and its visible parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

HALF_SIZE: tuple[float, float, float] = (0.65, 0.65, 0.025)
"""Half sizes of the table top (m). The table is centred below the world's origin, with its top at z = 0."""

_HEIGHT = 0.6
_WOOD, _METAL, _FLOOR = (0.62, 0.47, 0.32, 1.0), (0.25, 0.25, 0.28, 1.0), (0.78, 0.78, 0.76, 1.0)


@dataclass(frozen=True)
class Box:
    """Visible part of the table or the floor: an axis-aligned box with a colour.

    Lengths are in metres, in the frame at the centre of the table top.
    """

    center: tuple[float, float, float]
    half_size: tuple[float, float, float]
    color: tuple[float, float, float, float]
    roughness: float
    metallic: float = 0.0


def visible_boxes() -> tuple[Box, ...]:
    leg = (0.025, 0.025, _HEIGHT / 2 - HALF_SIZE[2])
    places = [(x, y, -HALF_SIZE[2] - leg[2]) for x in (-0.6, 0.6) for y in (-0.6, 0.6)]
    return (
        Box((0.0, 0.0, 0.0), HALF_SIZE, _WOOD, 0.6),
        *(Box(place, leg, _METAL, 0.4, 0.6) for place in places),
        Box((0.0, 0.0, HALF_SIZE[2] - _HEIGHT - 0.01), (12.0, 12.0, 0.005), _FLOOR, 0.9),
    )


def corners() -> npt.NDArray[np.float64]:
    """Return the corners of the table top as points (8, 3), relative to its centre, m."""
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).T.reshape(-1, 3)
    return np.asarray(signs * np.array(HALF_SIZE), dtype=np.float64)

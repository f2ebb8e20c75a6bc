"""Measure a lever on the side of an object, such as a toaster, in the points of one cloud."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array

Points = npt.NDArray[np.float32]

BELOW_TOP = 0.01
"""Minimum depth (m) of a lever below the top of the object; higher points also lie on the top."""
TOP, EDGE = 0.98, 0.97
"""Quantile of the heights of an object's points that counts as its top, and of their distances along the normal of a
side that counts as the place of this side."""
BESIDE, BEHIND, BEFORE = 0.04, 0.08, 0.04
"""Maximum distance (m) of a lever's points from the estimated keypoint: sideways, and along the normal of the side."""
LAYER, LEAST_RAISED = 0.005, 0.006
"""Thickness (m) of the layers of the side whose points are counted, and minimum height (m) of a lever's points above
the layer with most points."""
LEAST_POINTS, LEAST_ON_LEVER = 20, 4
"""Minimum number of points on the side, and on the lever, if the lever is measured."""
GAP = 0.012
"""Minimum vertical distance (m) between the points of two bodies on the side, such as a lever and a knob."""
GRIP = 0.9
"""Quantile of the heights of the lever's points above the side that counts as the place that the hand presses."""
LEAST_DEVIATIONS, MOST_DEVIATIONS = 1.0, 4.0
"""Maximum distance between the measured and the estimated end of the lever, in standard deviations of the keypoint, at
which the estimate is kept because it is as accurate, and at which the measured body is the lever."""


@dataclass(frozen=True)
class Lever:
    """Lever on the side of an object.

    Attributes:
        points: (N,) mask of the object's points that belong to the lever.
        end: (3,) middle of its upper end, m; the estimated keypoint if this is as accurate.
    """

    points: npt.NDArray[np.bool_]
    end: Array


def lever_near(keypoint: Array, deviation: float, points: Points, forwards: Array) -> Lever | None:
    """Return the lever near an estimated keypoint; None if no lever is measured.

    The points that stand out from the side of the object belong to levers and knobs. Points with a vertical gap between
    them belong to different ones. The one that is nearest to the estimated height is the lever.

    Args:
        keypoint: (3,) estimated keypoint in a frame with a vertical z axis, m.
        deviation: standard deviation of the distance from the keypoint to the true one, m.
        points: (N, 3) points of the object in this frame, m.
        forwards: (3,) horizontal unit vector that is normal to two sides of the object, in this frame.
    """
    found = points.astype(np.float64)
    is_below = found[:, 2] < np.quantile(found[:, 2], TOP) - BELOW_TOP
    if is_below.sum() < LEAST_POINTS:
        return None
    sides = found[is_below]
    sideways = np.array([-forwards[1], forwards[0], 0.0])
    normals = (forwards, sideways, -forwards, -sideways)
    beyond = [float(keypoint @ normal - np.quantile(sides @ normal, EDGE)) for normal in normals]
    outwards = normals[int(np.argmax(beyond))]
    across = np.array([-outwards[1], outwards[0], 0.0])
    raised, beside = (sides - keypoint) @ outwards, (sides - keypoint) @ across
    is_near = (np.abs(beside) < BESIDE) & (raised > -BEHIND) & (raised < BEFORE)
    if max(beyond) < 0.0 or is_near.sum() < LEAST_POINTS:
        return None
    counts = np.bincount(((raised[is_near] + BEHIND) / LAYER).astype(int))
    on_it = is_near & (raised > LAYER * (1 + np.argmax(counts)) - BEHIND + LEAST_RAISED)
    heights = np.sort(sides[on_it, 2])
    bodies = np.split(heights, np.flatnonzero(np.diff(heights) > GAP) + 1)
    bodies = [each for each in bodies if len(each) >= LEAST_ON_LEVER]
    if not bodies:
        return None
    lever = min(bodies, key=lambda each: abs(0.5 * (each[0] + each[-1]) - keypoint[2]))
    on_it &= (sides[:, 2] >= lever[0]) & (sides[:, 2] <= lever[-1])
    by = 0.5 * (beside[on_it].min() + beside[on_it].max()) * across + np.quantile(raised[on_it], GRIP) * outwards
    by[2] = lever[-1] - keypoint[2]
    away = float(np.linalg.norm(by))
    if away > MOST_DEVIATIONS * deviation:
        return None
    mask = np.zeros(len(points), dtype=bool)
    mask[is_below] = on_it
    return Lever(mask, np.asarray(keypoint + by) if away > LEAST_DEVIATIONS * deviation else keypoint)

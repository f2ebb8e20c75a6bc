"""Correct the estimated keypoints of a box, and of a cabinet, such as a refrigerator, by the points on its door."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array

Points = npt.NDArray[np.float32]

IN_CABINET, REACH = "articulated_object_inside_base", 0.11
"""Name of the keypoint inside a cabinet with a door, and its mean distance (m) from the front of generated cabinets."""
FORWARDS = 0.15
"""Shift of the keypoint inside a box away from the hinge, as a fraction of its distance from the hinge. The keypoint of
generated boxes is in the middle; the keypoint of boxes from PartNet-Mobility is one third of this distance further.
"""
FAR_EDGE = 0.95
"""Quantile of the distances of a door's points from its axis that counts as the door's width."""
LEAST_POINTS, LEAST_ON_HANDLE = 24, 8
"""Minimum number of points on a door, and on its handle, if the door or the handle is measured."""
LAYER, LEAST_OF_FACE = 0.005, 0.3
"""Thickness (m) of the layers of a door whose points are counted, and minimum number of points in the layer of its
front, as a fraction of the largest number."""
LEAST_RAISED, MOST_RAISED, BESIDE = 0.008, 0.1, 0.01
"""Minimum and maximum height (m) of a handle's points above the front of the door, and maximum distance (m) of these
points beside the front."""
UNCERTAIN, MOST_DEVIATIONS = 0.045, 1.3
"""Minimum standard deviation (m) of an estimated keypoint that the measured handle replaces, and maximum distance of
the handle from this keypoint in standard deviations. A door also has locks and knobs."""
MEASURED = 0.01
"""Standard deviation (m) of a measured keypoint."""
EDGES, OUTERMOST = (0.03, 0.97), 0.9
"""Quantiles of points that count as the edges of a door and of a handle, and quantile of the heights of a handle's
points above the front that counts as the height of its grip."""
INSET = 0.015
"""Minimum distance (m) of a door's handle from the edge of the door that is opposite the axis."""


def in_cabinet(keypoint: Array, door: Points, origin: Array, inwards: Array) -> Array:
    """Return the keypoint inside a cabinet, corrected by the cabinet's door.

    The network places the keypoint in the middle of the cabinet, but the hand does not reach the middle of a deep
    cabinet. The corrected keypoint is ``REACH`` behind the joint axis, which lies in the front of the cabinet.
    Sideways, it is the mean of the estimated point and the middle of the door when the door is closed.

    Args:
        keypoint: (3,) estimated keypoint in a frame with a vertical z axis, m.
        door: (M, 3) points of the door in this frame, m.
        origin: (3,) point on the vertical joint axis, m.
        inwards: (3,) horizontal unit vector from the front of the cabinet to its back, in this frame.
    """
    across = np.array([-inwards[1], inwards[0], 0.0])
    away = keypoint - origin
    by = (REACH - away @ inwards) * inwards
    if len(door) >= LEAST_POINTS:
        width = float(np.quantile(np.linalg.norm((door - origin)[:, :2], axis=1), FAR_EDGE))
        beside = float(away @ across)
        by = by + 0.5 * (np.copysign(0.5 * width, beside) - beside) * across
    return np.asarray(keypoint + by)


def in_box(keypoint: Array, origin: Array, inwards: Array) -> Array:
    """Return the keypoint inside a box with a lid, shifted away from the hinge by ``FORWARDS`` of its distance.

    Args:
        keypoint: (3,) estimated keypoint in a frame with a vertical z axis, m.
        origin: (3,) point on the horizontal joint axis, m.
        inwards: (3,) horizontal unit vector from the front of the box to its hinge, in this frame.
    """
    return np.asarray(keypoint + FORWARDS * ((keypoint - origin) @ inwards) * inwards)


def on_door(keypoint: Array, deviation: float, door: Points, origin: Array, turn: float) -> tuple[Array, float]:
    """Return the keypoint on the handle of a door, corrected by the points of the door, and its standard deviation (m).

    The points that stand out from the front of the door show its handle. If no handle is visible near the estimated
    keypoint, the keypoint is only moved sideways, because a handle never lies beyond the edge of its door.

    Args:
        keypoint: (3,) estimated keypoint in a frame with a vertical z axis, m.
        deviation: standard deviation of the distance from the keypoint to the true one, m.
        door: (M, 3) points of the door in this frame, m.
        origin: (3,) point on the vertical joint axis, m.
        turn: direction in which the door opens about the z axis, 1 or -1.
    """
    if len(door) < LEAST_POINTS:
        return keypoint, deviation
    points = door.astype(np.float64) - origin
    level = points * [1.0, 1.0, 0.0]
    middle = level.mean(axis=0)
    across = np.linalg.svd(level - middle, full_matrices=False)[2][0]
    across = across if across @ middle > 0 else -across
    outwards = np.cross([0.0, 0.0, turn], across)
    beside, raised, height = points @ across, points @ outwards, points[:, 2]
    counts = np.bincount(((raised - raised.min()) / LAYER).astype(int))
    front = raised.min() + LAYER * (1 + np.flatnonzero(counts > LEAST_OF_FACE * counts.max())[-1])
    face = (raised < front) & (raised > front - 2 * LAYER)
    stands_out = (raised > front + LEAST_RAISED) & (raised < front + MOST_RAISED)
    for along in (beside, height):
        low, high = np.quantile(along[face], EDGES)
        stands_out &= (along > low - BESIDE) & (along < high + BESIDE)
    if deviation > UNCERTAIN and stands_out.sum() >= LEAST_ON_HANDLE:
        grip = 0.5 * (np.quantile(beside[stands_out], EDGES).sum() * across)
        grip += np.quantile(raised[stands_out], OUTERMOST) * outwards
        grip[2] = 0.5 * np.quantile(height[stands_out], EDGES).sum()
        if np.linalg.norm(origin + grip - keypoint) < MOST_DEVIATIONS * deviation:
            return origin + grip, MEASURED
    beyond = float((keypoint - origin) @ across - np.quantile(beside, EDGES[1])) + INSET
    return keypoint - max(beyond, 0.0) * across, deviation

"""Measure the bail of a bucket, the arched handle that swings over it, in the points of one cloud."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array

Points = npt.NDArray[np.float32]

LAYER = 0.01
"""Height of the horizontal layers whose points are counted, m."""
THIN = 0.25
"""Maximum number of points in a layer of the bail, as a fraction of the median number in the lower half of the
object."""
ABOVE = 0.005
"""Distance (m) from the rim above which points belong to the bail."""
LEAST_RAISED, LEAST_OF_BAIL = 0.02, 8
"""Minimum height (m) of the bail above the rim, and minimum number of its points, if it can be measured."""
MOST_FLAT = 0.35
"""Maximum thickness of the bail's points, as a fraction of their second extent, if they lie on a plane."""
TIP = 0.97
"""Quantile of the bail's points along its plane that counts as the middle of the arch."""


@dataclass(frozen=True)
class Bail:
    """Bail of a bucket that is not lowered onto the rim.

    Attributes:
        points: (N,) mask of the object's points that belong to the bail.
        axis: (3,) unit vector along the axis about which the bail swings, horizontal.
        origin: (3,) point on the axis, m.
        angle: angle of the bail from the vertical about the axis, rad.
        middle: (3,) middle of the arch, m.
    """

    points: npt.NDArray[np.bool_]
    axis: Array
    origin: Array
    angle: float
    middle: Array


def raised_bail(points: Points, axis: Array, origin: Array) -> Bail | None:
    """Return the bail of a bucket; None if it lies on the rim, where it cannot be told from the bucket.

    Above the rim, a horizontal layer of the object contains much fewer points than below it. The points above the rim
    lie on a plane through the axis. A bucket is round, so only this plane shows the direction of the axis.

    Args:
        points: (N, 3) points of the bucket in a frame with a vertical z axis, m.
        axis: (3,) estimated direction of the axis; it determines the sign of the measured direction.
        origin: (3,) estimated point on the axis, m; only its height is used.
    """
    found = points.astype(np.float64)
    low = found[:, 2].min()
    counts = np.bincount(((found[:, 2] - low) / LAYER).astype(int))
    least = THIN * float(np.median(counts[: max(len(counts) // 2, 1)]))
    thin = np.flatnonzero(counts[np.argmax(counts) :] < least)
    if not len(thin):
        return None
    rim = low + LAYER * (np.argmax(counts) + thin[0])
    above = found[:, 2] > rim + ABOVE
    bail = found[above]
    if len(bail) < LEAST_OF_BAIL or bail[:, 2].max() < rim + LEAST_RAISED:
        return None
    center = bail.mean(axis=0)
    _, extents, directions = np.linalg.svd(bail - center, full_matrices=False)
    normal = directions[2]
    level = np.array([normal[0], normal[1], 0.0])
    if extents[2] > MOST_FLAT * extents[1] or np.linalg.norm(level) < ABOVE:
        return None
    along = np.array([-normal[1], normal[0], 0.0]) / np.linalg.norm(level)
    along = along if along @ axis >= 0 else -along
    body = found[~above]
    start = np.append(0.5 * (body[:, :2].min(axis=0) + body[:, :2].max(axis=0)), origin[2])
    start = start - level * ((start - center) @ normal) / (level @ level)
    up = np.cross(normal, along)
    up = up if up[2] > 0 else -up
    reach, beside = (bail - start) @ up, (bail - start) @ along
    return Bail(
        points=above,
        axis=along,
        origin=start,
        angle=float(np.arctan2(np.cross([0.0, 0.0, 1.0], up) @ along, up[2])),
        middle=start + float(np.quantile(reach, TIP)) * up + 0.5 * float(beside.min() + beside.max()) * along,
    )

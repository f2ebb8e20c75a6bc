"""Fewer points that stand for many: evenly over the pictures, then evenly over space; and those that stand alone."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import MissingExtraError

Points = npt.NDArray[np.float32]
Indices = npt.NDArray[np.int64]

_TREE_HEIGHT = 5
"""Of fpsample's buckets: fastest between 2,000 and 8,000 points; any gives a farthest point sampling."""


def uniform_stride(count: int, wanted: int) -> Indices:
    """Indices of at most ``wanted`` of ``count`` things, evenly spread over their order."""
    if count <= wanted:
        return np.arange(count)
    middles = (np.arange(wanted) + 0.5) * (count / wanted)
    return np.asarray(np.floor(middles), dtype=np.int64)


def farthest_points(points: Points, wanted: int) -> Indices:
    """(wanted,) indices of points, each as far as can be from those chosen before; sorted.

    Where there are fewer points than that, all of them in turn, over and over.

    Args:
        points: (N, 3) finite, N at least 1.

    Raises:
        MissingExtraError: fpsample is not installed.
    """
    if len(points) <= wanted:
        return np.sort(np.arange(wanted) % len(points))
    try:
        import fpsample
    except ImportError as error:
        raise MissingExtraError("fpsample", "sim") from error
    height = min(_TREE_HEIGHT, int(np.log2(len(points))))  # no more buckets than points
    chosen = fpsample.bucket_fps_kdline_sampling(points, wanted, h=height, start_idx=0)
    return np.sort(chosen.astype(np.int64))


def inlier_mask(points: Points, neighbors: int, deviations: float) -> npt.NDArray[np.bool_]:
    """(N,) whether each point is no outlier: its mean distance to its nearest ``neighbors`` is at most the mean of all
    such distances plus so many standard deviations."""
    from scipy.spatial import cKDTree

    if len(points) <= neighbors:
        return np.ones(len(points), dtype=bool)
    distances, _ = cKDTree(points).query(points, k=neighbors + 1)  # the nearest is the point itself
    mean = distances[:, 1:].mean(axis=1)
    kept: npt.NDArray[np.bool_] = mean <= mean.mean() + deviations * mean.std()
    return kept

"""Intersect convex hulls, given as planes, with straight lines."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from gensim2.core.arrays import Array


class HullsKey:
    """Cache key for a tuple of hulls. Two keys are equal only if they hold the same tuple object.

    Args:
        hulls: convex vertex sets, each (N, 3).
    """

    def __init__(self, hulls: tuple[Array, ...]) -> None:
        self.hulls = hulls

    def __hash__(self) -> int:
        return id(self.hulls)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, HullsKey) and other.hulls is self.hulls


def crossings(hulls: tuple[Array, ...], points: Array, along: Array) -> tuple[Array, Array]:
    """Return where parallel lines enter and leave hulls. The planes are cached for each tuple object.

    Args:
        hulls: H convex vertex sets.
        points: (N, 3) a point on each line.
        along: (3,) unit direction of all lines.

    Returns:
        Two arrays (N, H): the signed distance (m) to the point where the line enters each hull, and to the point where
        it leaves the hull. Both distances are inf and -inf if the line misses the hull.
    """
    enters, leaves = [], []
    for planes in _planes(HullsKey(hulls)):
        distance, slope = points @ planes[:, :3].T + planes[:, 3], planes[:, :3] @ along
        level = np.abs(slope) < 1e-9
        at = -distance[:, ~level] / slope[~level]
        rising = slope[~level] > 0
        enter, leave = at[:, ~rising].max(axis=1, initial=-np.inf), at[:, rising].min(axis=1, initial=np.inf)
        passes = (distance[:, level] > 0).any(axis=1) | (enter >= leave)
        enters.append(np.where(passes, np.inf, enter))
        leaves.append(np.where(passes, -np.inf, leave))
    return np.stack(enters, axis=1), np.stack(leaves, axis=1)


@lru_cache(maxsize=64)
def _planes(key: HullsKey) -> tuple[Array, ...]:
    """Return the outward normals and offsets (K, 4) of each hull."""
    from scipy.spatial import ConvexHull  # imported here because checking a strategy does not need SciPy

    return tuple(np.asarray(ConvexHull(hull, qhull_options="QJ").equations, dtype=np.float64) for hull in key.hulls)

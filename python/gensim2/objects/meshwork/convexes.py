"""Points and convex hulls: surfaces as points, and how deep points lie in hulls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

Array = npt.NDArray[np.float64]

HINGE = 0.012  # m around the axis that counts as hinge: there links may overlap
SAMPLE_SPACING = 0.006  # m between points that stand for a hull's surface


def planes_of(hull: Array) -> Array:
    """(M, 4) outward planes of the hull of (N, 3) points."""
    return np.asarray(np.unique(np.round(ConvexHull(hull).equations, 9), axis=0))


def heights(points: Array, planes: Array) -> Array:
    """(K,) distance of (K, 3) points above the highest of (M, 4) outward planes; negative inside all.

    Points stand in columns: a maximum over rows of few numbers takes six times as long.
    """
    above = planes[:, :3] @ points.T
    above += planes[:, 3, None]
    return np.asarray(above.max(axis=0))


def triangle_weights(n: int) -> Array:
    """(K, 3) barycentric weights of the points that cut a triangle's edges into ``n`` parts."""
    i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
    inside = i + j <= n
    u, v = i[inside] / n, j[inside] / n
    return np.stack([1 - u - v, u, v], axis=1)


_kept_weights = lru_cache(64)(triangle_weights)


def surface_samples(hull: Array, spacing: float = SAMPLE_SPACING) -> Array:
    """Points on the surface of the hull of (N, 3) points, corners included."""
    corners = hull[ConvexHull(hull).simplices]
    steps = np.ceil(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1) / spacing)
    samples = [hull]
    for triangle, n in zip(corners, steps, strict=True):
        samples.append(_kept_weights(int(n)) @ triangle)
    return np.concatenate(samples)


def in_box(points: Array, low: Array, high: Array) -> npt.NDArray[np.bool_]:
    """Which of (N, 3) points lie between two corners; by columns, which is quicker than ``all`` over rows of three."""
    found = (points[:, 0] > low[0]) & (points[:, 0] < high[0])
    for i in (1, 2):
        found &= points[:, i] > low[i]
        found &= points[:, i] < high[i]
    return np.asarray(found, bool)


@dataclass(frozen=True)
class ConvexBlock:
    """A convex hull ready for queries: corners of its bounding box, outward planes (M, 4)."""

    low: Array
    high: Array
    planes: Array

    @staticmethod
    def of(hull: Array) -> ConvexBlock:
        """The block of a hull given by its (N, 3) vertices."""
        return ConvexBlock(hull.min(axis=0), hull.max(axis=0), planes_of(hull))

    def depth(self, points: Array) -> Array:
        """(K,) distance of points below the nearest face plane; negative outside."""
        return -heights(points, self.planes)


def depth_inside(points: Array, blocks: Sequence[ConvexBlock]) -> Array:
    """(K,) how deep points lie inside the deepest of several hulls; 0 outside of all."""
    deepest = np.zeros(len(points))
    for block in blocks:
        near = np.flatnonzero(in_box(points, block.low, block.high))
        if len(near):
            deepest[near] = np.maximum(deepest[near], block.depth(points[near]))
    return deepest

"""Compute surface samples of convex hulls, and the depth of points inside hulls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

from gensim2.core.arrays import Array

HINGE = 0.012  # m, radius around the joint axis of the hinge region, in which links may overlap
SAMPLE_SPACING = 0.006  # m, distance between neighbouring sample points on a hull's surface


def planes_of(hull: Array) -> Array:
    """Return the outward planes (M, 4) of the hull of (N, 3) points."""
    return np.asarray(np.unique(np.round(ConvexHull(hull).equations, 9), axis=0))


def heights(points: Array, planes: Array) -> Array:
    """Return the largest signed distance (K,) of points (K, 3) from the planes (M, 4) of a hull, negative inside.

    The code uses an array (M, K), because with few planes its maximum is six times as fast as the maximum of an array
    (K, M).
    """
    above = planes[:, :3] @ points.T
    above += planes[:, 3, None]
    return np.asarray(above.max(axis=0))


def triangle_weights(n: int) -> Array:
    """Return the barycentric weights (K, 3) of a grid on a triangle whose edges are divided into ``n`` parts."""
    i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
    inside = i + j <= n
    u, v = i[inside] / n, j[inside] / n
    return np.stack([1 - u - v, u, v], axis=1)


_kept_weights = lru_cache(64)(triangle_weights)


def surface_samples(hull: Array, spacing: float = SAMPLE_SPACING) -> Array:
    """Return points on the surface of the hull of (N, 3) points, vertices included."""
    corners = hull[ConvexHull(hull).simplices]
    steps = np.ceil(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1) / spacing)
    samples = [hull]
    for triangle, n in zip(corners, steps, strict=True):
        samples.append(_kept_weights(int(n)) @ triangle)
    return np.concatenate(samples)


def in_box(points: Array, low: Array, high: Array) -> npt.NDArray[np.bool_]:
    """Return a mask of the points (N, 3) in a box. Tests for each coordinate are faster than ``all`` over rows."""
    found = (points[:, 0] > low[0]) & (points[:, 0] < high[0])
    for i in (1, 2):
        found &= points[:, i] > low[i]
        found &= points[:, i] < high[i]
    return np.asarray(found, bool)


@dataclass(frozen=True)
class ConvexBlock:
    """A convex hull prepared for fast queries: bounding box and outward planes (M, 4)."""

    low: Array
    high: Array
    planes: Array

    @staticmethod
    def of(hull: Array) -> ConvexBlock:
        """Prepare the hull of (N, 3) vertices."""
        return ConvexBlock(hull.min(axis=0), hull.max(axis=0), planes_of(hull))

    def depth(self, points: Array) -> Array:
        """Return the distance (K,) of each point to the nearest face plane of the hull, negative outside."""
        return -heights(points, self.planes)


def depth_inside(points: Array, blocks: Sequence[ConvexBlock]) -> Array:
    """Return the depth (K,) of points inside several hulls: the largest depth in any hull; 0 outside all hulls."""
    deepest = np.zeros(len(points))
    for block in blocks:
        near = np.flatnonzero(in_box(points, block.low, block.high))
        if len(near):
            deepest[near] = np.maximum(deepest[near], block.depth(points[near]))
    return deepest

"""Points and convex hulls: surfaces as points, and how deep points lie in hulls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

Array = npt.NDArray[np.float64]

HINGE = 0.012  # m around the axis that counts as hinge: there links may overlap
SAMPLE_SPACING = 0.006  # m between points that stand for a hull's surface


def planes_of(hull: Array) -> Array:
    """(M, 4) outward planes of the hull of (N, 3) points."""
    return np.asarray(np.unique(np.round(ConvexHull(hull).equations, 9), axis=0))


def surface_samples(hull: Array, spacing: float = SAMPLE_SPACING) -> Array:
    """Points on the surface of the hull of (N, 3) points, corners included."""
    corners = hull[ConvexHull(hull).simplices]
    samples = [hull]
    for triangle in corners:
        n = int(np.ceil(np.linalg.norm(triangle - np.roll(triangle, 1, axis=0), axis=1).max() / spacing))
        i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
        u, v = i[i + j <= n] / n, j[i + j <= n] / n
        samples.append(np.stack([1 - u - v, u, v], axis=1) @ triangle)
    return np.concatenate(samples)


def in_box(points: Array, low: Array, high: Array) -> npt.NDArray[np.bool_]:
    """Which of (N, 3) points lie between two corners; by columns, which is quicker than ``all`` over rows of three."""
    found = (points[:, 0] > low[0]) & (points[:, 0] < high[0])
    for i in (1, 2):
        found &= points[:, i] > low[i]
        found &= points[:, i] < high[i]
    return np.asarray(found, bool)


@dataclass(frozen=True)
class Block:
    """A convex hull ready for queries: corners of its bounding box, outward planes (M, 4)."""

    low: Array
    high: Array
    planes: Array

    @staticmethod
    def of(hull: Array) -> Block:
        """The block of a hull given by its (N, 3) vertices."""
        return Block(hull.min(axis=0), hull.max(axis=0), planes_of(hull))

    def depth(self, points: Array) -> Array:
        """(K,) distance of points below the nearest face plane; negative outside."""
        return np.asarray(-(points @ self.planes[:, :3].T + self.planes[:, 3]).max(axis=1))


def depth_inside(points: Array, blocks: Sequence[Block]) -> Array:
    """(K,) how deep points lie inside the deepest of several hulls; 0 outside of all."""
    deepest = np.zeros(len(points))
    for block in blocks:
        near = np.flatnonzero(in_box(points, block.low, block.high))
        if len(near):
            deepest[near] = np.maximum(deepest[near], block.depth(points[near]))
    return deepest

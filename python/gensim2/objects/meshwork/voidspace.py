"""Voids that a convex hull would fill: the space around a triangle soup that can be reached from outside, on a grid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from gensim2.objects.meshwork.convexes import heights, in_box, triangle_weights

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]

FINEST = 0.003  # m, edge of a cell
CELLS = 96  # along the longest side, where FINEST would take more
MAX_FINE_CELLS = 8_000_000
CHUNK = 400_000  # sample points at a time
NEEDED_VOLUME = 1.1e-6  # m³ that a point which another link needs counts for: more than a hull may ever fill
NEEDED_DEPTH = 0.0008  # m that such a point may lie inside a hull
MAX_PROBES = 5000  # cells looked at for one hull, about; a bigger hull is probed more coarsely


class VoidSpace:
    """Cells that a fingertip could get to: not crossed by the surface, and connected to the outside.

    No need of watertight meshes: what is sealed off, gaps narrower than a cell included, counts as solid.

    Attributes:
        cell: edge length in metres.
        low, high: (3,) corners of the box around the link.
    """

    def __init__(self, meshes: Sequence[tuple[Array, Faces]]) -> None:
        """``meshes``: (vertices (N, 3) in metres, faces (M, 3)) of one link, all in its frame."""
        points = np.concatenate([v for v, _ in meshes])
        low, high = points.min(axis=0), points.max(axis=0)
        self.cell = max(FINEST, float((high - low).max()) / CELLS)
        self._meshes = list(meshes)
        self.low, self.high = low, high
        self._low = low - 2 * self.cell
        self._shape = tuple(int(n) for n in np.ceil((high - low) / self.cell) + 4)
        crossed = np.zeros(self._shape, bool)
        for vertices, faces in meshes:
            for samples in self._samples(vertices[faces], self.cell):
                index = ((samples - self._low) / self.cell).astype(np.int64)
                crossed[index[:, 0], index[:, 1], index[:, 2]] = True
        label, _ = ndimage.label(~crossed)
        self._free = label == label[0, 0, 0]
        self._needed = np.zeros((0, 3))  # sorted along one axis
        self._needed_axis = 0

    def occupied(self) -> Array:
        """(N, 3) centres of the cells that cannot be reached: what the meshes cross and what they enclose."""
        return np.asarray(self._low + (np.argwhere(~self._free) + 0.5) * self.cell)

    def is_free(self, points: Array) -> npt.NDArray[np.bool_]:
        """Which of (N, 3) points can be reached from outside."""
        index = np.floor((points - self._low) / self.cell).astype(np.int64)
        inside = ((index >= 0) & (index < self._shape)).all(axis=1)
        found = np.ones(len(points), bool)
        i = index[inside]
        found[inside] = self._free[i[:, 0], i[:, 1], i[:, 2]]
        return found

    def is_free_finely(self, points: Array, finest: float) -> npt.NDArray[np.bool_]:
        """Like ``is_free``, on cells of ``finest`` metres around those points that the coarse ones leave in doubt."""
        found = self.is_free(points)
        doubtful = points[~found]
        if not len(doubtful):
            return found
        low, high = doubtful.min(axis=0) - 2 * self.cell, doubtful.max(axis=0) + 2 * self.cell
        cell = max(finest, float(np.prod(high - low) / MAX_FINE_CELLS) ** (1 / 3))
        shape = np.ceil((high - low) / cell).astype(np.int64)
        crossed = np.zeros(shape, bool)
        for vertices, faces in self._meshes:
            triangles = vertices[faces]
            near = ((triangles.max(axis=1) > low) & (triangles.min(axis=1) < high)).all(axis=1)
            for samples in self._samples(triangles[near], cell):
                index = np.floor((samples - low) / cell).astype(np.int64)
                index = index[((index >= 0) & (index < shape)).all(axis=1)]
                crossed[index[:, 0], index[:, 1], index[:, 2]] = True
        # Open where it is connected to a coarse cell that is.
        coarse = [
            np.clip((low[i] + (np.arange(shape[i]) + 0.5) * cell - self._low[i]) / self.cell, 0, self._shape[i] - 1)
            for i in range(3)
        ]
        seeds = self._free[np.ix_(*(index.astype(np.int64) for index in coarse))] & ~crossed
        label, count = ndimage.label(~crossed)
        is_open = np.zeros(count + 1, bool)
        is_open[label[seeds]] = True
        is_open[0] = False
        i = ((doubtful - low) / cell).astype(np.int64)
        found[~found] = is_open[label[i[:, 0], i[:, 1], i[:, 2]]]
        return found

    def keep_clear(self, points: Array) -> None:
        """Make hulls over the (N, 3) ``points`` dear: something else moves there."""
        self._needed_axis = int(np.argmax(np.ptp(points, axis=0))) if len(points) else 0
        self._needed = points[np.argsort(points[:, self._needed_axis], kind="stable")]

    @staticmethod
    def _samples(triangles: Array, cell: float) -> list[Array]:
        """Points on (M, 3, 3) triangles, closer together than a cell."""
        edges = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
        steps = np.maximum(1, np.ceil(edges / (0.7 * cell))).astype(np.int64)
        batches = []
        for n in np.unique(steps):
            weights = triangle_weights(int(n))
            chosen = triangles[steps == n]
            for part in np.array_split(chosen, max(1, len(chosen) * len(weights) // CHUNK)):
                batches.append(np.matmul(weights, part).reshape(-1, 3))
        return batches

    def filled(self, points: Array, planes: Array) -> float:
        """Reachable volume in m³ inside the hull with vertices (N, 3) and outward planes (M, 4).

        Each point of ``keep_clear`` inside counts as ``NEEDED_VOLUME``.
        """
        low, high = points.min(axis=0), points.max(axis=0)
        needed = 0
        if len(self._needed):
            axis = self._needed_axis
            start, end = np.searchsorted(self._needed[:, axis], [low[axis], high[axis]])
            near = self._needed[start:end]
            near = near[in_box(near, low, high)]
            if len(near):
                needed = int((heights(near, planes) < -NEEDED_DEPTH).sum())
        return self._void(points, planes, low, high) + needed * NEEDED_VOLUME

    def _void(self, points: Array, planes: Array, low: Array, high: Array) -> float:
        """Free volume in a hull; ``low`` and ``high`` (3,) bound it."""
        widths = np.ptp(points @ planes[:, :3].T, axis=0)
        thin = int(np.argmin(widths))
        if widths[thin] < 2 * self.cell:
            return self._void_in_plate(points, planes, planes[thin, :3], float(widths[thin]))
        first = np.maximum(((low - self._low) / self.cell).astype(np.int64), 0)
        last = ((high - self._low) / self.cell).astype(np.int64) + 1
        stride = max(1, int(np.ceil((np.prod(last - first) / MAX_PROBES) ** (1 / 3))))
        offset = (stride - 1) // 2
        window = tuple(slice(a + offset, b, stride) for a, b in zip(first, last, strict=True))
        index = np.argwhere(self._free[window])
        if not len(index):
            return 0.0
        centers = self._low + (index * stride + first + offset + 0.5) * self.cell
        return float((heights(centers, planes) < -0.5 * self.cell).sum()) * (stride * self.cell) ** 3

    def _void_in_plate(self, points: Array, planes: Array, normal: Array, width: float) -> float:
        """Free volume in a hull so thin that cells would miss it: probed on its middle plane."""
        u = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
        u /= np.linalg.norm(u)
        v = np.cross(normal, u)
        flat = points @ np.stack([u, v, normal], axis=1)
        low, high = flat.min(axis=0), flat.max(axis=0)
        step = max(self.cell, float(np.sqrt((high - low)[0] * (high - low)[1] / MAX_PROBES)))
        a, b = (np.arange(low[i] + step / 2, high[i], step) for i in (0, 1))
        if not len(a) or not len(b):
            return 0.0
        grid = np.stack(np.meshgrid(a, b, indexing="ij"), axis=-1).reshape(-1, 2)
        probes = grid @ np.stack([u, v]) + 0.5 * (low[2] + high[2]) * normal
        edge = np.abs(planes[:, :3] @ normal) < 0.5  # faces around the plate, not the two big ones
        inside = np.ones(len(probes), bool)
        if edge.any():
            inside = heights(probes, planes[edge]) < -0.5 * self.cell
        return float(self.is_free(probes[inside]).sum()) * step * step * width

"""What a convex hull would fill: the space around a triangle soup that can be reached from outside, on a grid."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]

FINEST = 0.003  # m, edge of a cell
CELLS = 96  # along the longest side, where FINEST would take more
CHUNK = 400_000  # sample points at a time
MOST_PROBES = 5000  # cells looked at for one hull, about; a bigger hull is probed more coarsely


class VoidSpace:
    """Cells that a fingertip could get to: not crossed by the surface, and connected to the outside.

    No need of watertight meshes: what is sealed off, gaps narrower than a cell included, counts as solid.

    Attributes:
        cell: edge length in metres.
    """

    def __init__(self, meshes: list[tuple[Array, Faces]]) -> None:
        """``meshes``: (vertices (N, 3) in metres, faces (M, 3)) of one link, all in its frame."""
        points = np.concatenate([v for v, _ in meshes])
        low, high = points.min(axis=0), points.max(axis=0)
        self.cell = max(FINEST, float((high - low).max()) / CELLS)
        self._low = low - 2 * self.cell
        self._shape = tuple(int(n) for n in np.ceil((high - low) / self.cell) + 4)
        crossed = np.zeros(self._shape, bool)
        for vertices, faces in meshes:
            for samples in self._samples(vertices[faces]):
                index = ((samples - self._low) / self.cell).astype(np.int64)
                crossed[index[:, 0], index[:, 1], index[:, 2]] = True
        label, _ = ndimage.label(~crossed)
        self._free = label == label[0, 0, 0]

    def _samples(self, triangles: Array) -> list[Array]:
        """Points on (M, 3, 3) triangles, closer together than a cell."""
        edges = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
        steps = np.maximum(1, np.ceil(edges / (0.7 * self.cell))).astype(np.int64)
        batches = []
        for n in np.unique(steps):
            i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
            inside = i + j <= n
            u, v = i[inside] / n, j[inside] / n
            weights = np.stack([1 - u - v, u, v], axis=1)
            chosen = triangles[steps == n]
            for part in np.array_split(chosen, max(1, len(chosen) * len(weights) // CHUNK)):
                batches.append(np.einsum("kc,mcd->mkd", weights, part).reshape(-1, 3))
        return batches

    def filled(self, points: Array, planes: Array) -> float:
        """Reachable volume in m³ inside the hull with vertices (N, 3) and outward planes (M, 4)."""
        first = np.maximum(((points.min(axis=0) - self._low) / self.cell).astype(np.int64), 0)
        last = ((points.max(axis=0) - self._low) / self.cell).astype(np.int64) + 1
        stride = max(1, int(np.ceil((np.prod(last - first) / MOST_PROBES) ** (1 / 3))))
        offset = (stride - 1) // 2
        window = tuple(slice(a + offset, b, stride) for a, b in zip(first, last, strict=True))
        index = np.argwhere(self._free[window])
        if not len(index):
            return 0.0
        centers = self._low + (index * stride + first + offset + 0.5) * self.cell
        reach = (centers @ planes[:, :3].T + planes[:, 3]).max(axis=1)
        return float((reach < -0.5 * self.cell).sum()) * (stride * self.cell) ** 3

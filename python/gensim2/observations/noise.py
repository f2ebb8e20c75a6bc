"""Noise of a stereo depth camera: steps of disparity, edges, holes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gensim2.errors import InputError

Depth = npt.NDArray[np.float32]


@dataclass(frozen=True)
class DepthNoise:
    """The defaults are those of a RealSense D435 at 848 x 480.

    Attributes:
        focal: pixels, of the stereo pair.
        baseline: m between its two cameras.
        disparity_sigma: pixels, standard deviation of a measured disparity.
        disparity_step: pixels to which a disparity is rounded.
        edge: m between neighbouring pixels from which on they lie at an edge.
        edge_lost: share of the pixels at an edge that measure nothing.
        edge_mixed: share of the pixels at an edge that measure something between the two sides.
        lost: share of all other pixels that measure nothing.
    """

    focal: float = 425.0
    baseline: float = 0.05
    disparity_sigma: float = 0.08
    disparity_step: float = 1.0 / 32.0
    edge: float = 0.02
    edge_lost: float = 0.3
    edge_mixed: float = 0.2
    lost: float = 0.005

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not isinstance(value, int | float) or not np.isfinite(value) or value < 0:
                raise InputError(f"must be a number of at least 0, is {value!r}", field=f"noise.{name}")
        if min(self.focal, self.baseline) <= 0:
            raise InputError("must be positive", field="noise.focal and noise.baseline")
        if self.edge_lost + self.edge_mixed > 1 or self.lost > 1:
            raise InputError("shares are at most 1 together", field="noise.edge_lost, noise.edge_mixed, noise.lost")

    def on(self, depth: Depth, generator: np.random.Generator) -> Depth:
        """(H, W) m as such a camera would have measured it; 0 stays 0, and stands for nothing measured."""
        seen = depth > 0
        draws = generator.random(depth.shape, dtype=np.float32)
        weights = generator.random(depth.shape, dtype=np.float32)
        errors = self.disparity_sigma * generator.standard_normal(depth.shape, dtype=np.float32)
        near, far = _around(depth)
        edges = seen & (far - near > self.edge)
        mixed = edges & (draws >= self.edge_lost) & (draws < self.edge_lost + self.edge_mixed)
        found = np.where(mixed, near + weights * (far - near), depth)
        disparity = self.focal * self.baseline / np.where(seen, found, 1.0) + errors
        if self.disparity_step:
            disparity = np.round(disparity / self.disparity_step) * self.disparity_step
        lost = ~seen | (disparity <= 0) | (draws < np.where(edges, self.edge_lost, self.lost))
        measured = self.focal * self.baseline / np.where(lost, 1.0, disparity)
        return np.where(lost, 0.0, measured).astype(np.float32)


def _around(depth: Depth) -> tuple[Depth, Depth]:
    """Least and largest depth of each pixel and its four neighbours, those that measure nothing left out."""
    low = np.where(depth > 0, depth, np.float32(np.inf))
    near, far = low.copy(), depth.copy()
    for here, there in (
        (np.s_[1:, :], np.s_[:-1, :]),
        (np.s_[:-1, :], np.s_[1:, :]),
        (np.s_[:, 1:], np.s_[:, :-1]),
        (np.s_[:, :-1], np.s_[:, 1:]),
    ):
        near[here] = np.minimum(near[here], low[there])
        far[here] = np.maximum(far[here], depth[there])
    return np.where(np.isfinite(near), near, np.float32(0.0)), far

"""Statistics of a column in ``meta/stats.json`` of a LeRobot data set, gathered episode by episode."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Totals:
    """Running sums from which the statistics of any number of frames follow, element by element."""

    count: int
    low: Array
    high: Array
    total: Array
    squares: Array

    @staticmethod
    def of(values: Array, picture: bool) -> Totals:
        """Those of (T, ...) frames; of pictures by channel, scaled to 0 to 1, as LeRobot does."""
        found = np.asarray(values, dtype=np.float64)
        if picture:
            found = found.reshape(-1, found.shape[-1]) / 255.0
        count = len(values)
        scale = count / len(found)
        return Totals(count, found.min(0), found.max(0), found.sum(0) * scale, np.square(found).sum(0) * scale)

    def plus(self, other: Totals) -> Totals:
        """Those of both."""
        return Totals(
            self.count + other.count,
            np.minimum(self.low, other.low),
            np.maximum(self.high, other.high),
            self.total + other.total,
            self.squares + other.squares,
        )

    def statistics(self, picture: bool) -> dict[str, Array]:
        """As LeRobot names and shapes them."""
        mean = self.total / self.count
        deviation = np.sqrt(np.maximum(self.squares / self.count - mean**2, 0.0))
        found = {"min": self.low, "max": self.high, "mean": mean, "std": deviation}
        shaped = {
            word: np.atleast_1d(each).reshape(-1, 1, 1) if picture else np.atleast_1d(each)
            for word, each in found.items()
        }
        return {**shaped, "count": np.array([self.count])}


def thinned(pictures: Array) -> Array:
    """Some pictures of an episode, enough for its statistics."""
    return np.asarray(pictures)[:: max(1, len(pictures) // 20)]

"""Convex hulls as planes, and where straight lines run inside them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class HullsKey:
    """Hulls as a key: the same tuple is the same key, and is kept alive by it.

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
    """Return where straight lines enter hulls and leave them; what is known of the hulls is kept by the tuple's
    identity.

    Args:
        hulls: H convex vertex sets.
        points: (N, 3) of each line one.
        along: (3,) unit direction of all of them.

    Returns:
        Two (N, H): of each line and hull the distance from the point, along the direction, at which it enters, and at
        which it leaves; inf and -inf where it passes by.
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
    """Of each hull (K, 4) outward normals and offsets."""
    from scipy.spatial import ConvexHull  # here: refusing a strategy needs none of SciPy

    return tuple(np.asarray(ConvexHull(hull, qhull_options="QJ").equations, dtype=np.float64) for hull in key.hulls)

"""The room inside a container, read from its convex collision parts: where something lies that is *in* it.

Its measured point (an object's last keypoint) lies in it, or above it where things are dropped into a box, and on the
link that contains: the moving link of a drawer, the body of a box or a refrigerator. On a grid over that link's hulls
a cell is room where no hull is, where there is something below it, and walls on three sides or on all four: a
refrigerator is open in front, a drawer's back may be missing. Of the connected rooms the one at or below the measured
point counts, as a box along the link's axes that reaches to the walls.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.spatial import ConvexHull

from gensim2.planning.hulls import HullsKey, crossings

Array = npt.NDArray[np.float64]

CELL = 0.005
"""Metres; where the link is long, a CELLS-th of its longest side."""
CELLS = 64

WALLS = 3
"""Of the four sides, so many must have a wall."""

NEAR = 0.03
"""Metres beside the measured point within which the room must begin."""

BELOW = 0.15
"""Metres below or above the measured point within which it must."""

SMALLEST = 0.02
"""Metres of the shortest side of a room; a nook is none."""

FILLED = 0.5
"""Share of a side of the box, one cell thick, that must be room; the box loses what is less."""


@dataclass(frozen=True)
class InnerBox:
    """A box along the axes of a link.

    Attributes:
        low, high: (3,) corners in the link's frame, m.
    """

    low: Array
    high: Array

    def contains(self, point: Array) -> bool:
        """Whether (3,) lies in it, link frame."""
        return bool(((self.low <= point) & (point <= self.high)).all())


def inner_box(hulls: tuple[Array, ...], measured_point: Array, up: Array) -> InnerBox | None:
    """The room inside a link; None where it has none at its measured point.

    Args:
        hulls: convex vertex sets of the link, each (N, 3) metres in its frame; what is found is kept by their identity.
        measured_point: (3,) in the link's frame.
        up: (3,) the vertical in the link's frame; the axis nearest to it counts.
    """
    axis = int(np.argmax(np.abs(up)))
    return _inner_box(HullsKey(hulls), tuple(map(float, measured_point)), axis, bool(up[axis] > 0))


@lru_cache(maxsize=64)
def _inner_box(key: HullsKey, measured_point: tuple[float, ...], axis: int, upwards: bool) -> InnerBox | None:
    points = np.concatenate(key.hulls)
    low, high = points.min(axis=0), points.max(axis=0)
    cell = max(CELL, float((high - low).max()) / CELLS)
    shape = np.ceil((high - low) / cell).astype(int)
    solid = _solid(key.hulls, low, cell, shape)
    room = ~solid & _behind(solid, axis, upwards) & _walled(solid, axis)
    label, count = ndimage.label(room)
    if count == 0:
        return None
    cells = np.argwhere(room)
    apart = np.abs(low + (cells + 0.5) * cell - measured_point)
    beside = np.linalg.norm(np.delete(apart, axis, axis=1), axis=1)
    reachable = (beside <= NEAR) & (apart[:, axis] <= BELOW)
    if not reachable.any():
        return None
    nearest = int(np.argmin(np.where(reachable, beside + apart[:, axis], np.inf)))
    first, last = _box(label == label[tuple(cells[nearest])])
    if (last + 1 - first).min() * cell < SMALLEST:
        return None
    return _up_to_the_walls(key.hulls, InnerBox(low + first * cell, low + (last + 1) * cell), cell)


def _solid(hulls: tuple[Array, ...], low: Array, cell: float, shape: npt.NDArray[np.int_]) -> npt.NDArray[np.bool_]:
    """Cells that a hull comes to within half a cell of the middle of: no wall is so thin that it falls between."""
    solid = np.zeros(shape, bool)
    for hull in hulls:
        planes = np.unique(ConvexHull(hull, qhull_options="QJ").equations.round(9), axis=0)
        first = np.maximum(np.floor((hull.min(axis=0) - low) / cell - 1).astype(int), 0)
        last = np.minimum(np.ceil((hull.max(axis=0) - low) / cell + 1).astype(int), shape)
        places = np.stack(np.meshgrid(*map(np.arange, first, last), indexing="ij"), axis=-1)
        middles = low + (places + 0.5) * cell
        inside = (middles @ planes[:, :3].T + planes[:, 3] <= 0.5 * cell).all(axis=-1)
        solid[tuple(map(slice, first, last))] |= inside
    return solid


def _up_to_the_walls(hulls: tuple[Array, ...], box: InnerBox, cell: float) -> InnerBox:
    """A box made of cells, each side of it moved to the wall behind it: what lies flat on the floor is inside, too.

    Walls are within two cells: one that a hull comes near to is no room, and one layer that is mostly no room is left
    out where a wall is uneven. A side without any stays.
    """
    corners = [box.low.copy(), box.high.copy()]
    spread = np.linspace(0.1, 0.9, 9)
    for axis in range(3):
        for corner, sign in zip(corners, (-1.0, 1.0), strict=True):
            shares = np.stack(np.meshgrid(*[spread] * 3, indexing="ij"), axis=-1)
            points = box.low + shares.take(0, axis).reshape(-1, 3) * (box.high - box.low)
            points[:, axis] = corner[axis] - sign * cell / 2  # in the outermost cells
            enter, _ = crossings(hulls, points, sign * np.eye(3)[axis])
            to_wall = float(np.median(np.where(enter >= 0.0, enter, np.inf).min(axis=1))) - cell / 2
            if 0.0 < to_wall <= 2 * cell:
                corner[axis] += sign * to_wall
    return InnerBox(*corners)


def _behind(solid: npt.NDArray[np.bool_], axis: int, forwards: bool) -> npt.NDArray[np.bool_]:
    """Cells from which there is something solid against the axis, or along it where not ``forwards``."""
    turned = solid if forwards else np.flip(solid, axis)
    found = np.maximum.accumulate(turned, axis)
    return found if forwards else np.flip(found, axis)


def _walled(solid: npt.NDArray[np.bool_], up: int) -> npt.NDArray[np.bool_]:
    sides = [_behind(solid, axis, forwards) for axis in range(3) if axis != up for forwards in (True, False)]
    return np.asarray(np.sum(sides, axis=0) >= WALLS)


def _box(room: npt.NDArray[np.bool_]) -> tuple[npt.NDArray[np.int_], npt.NDArray[np.int_]]:
    """First and last cell of the box around a room, without sides that are mostly no room."""
    cells = np.argwhere(room)
    first, last = cells.min(axis=0), cells.max(axis=0)
    while (last > first).all():
        inside = room[tuple(map(slice, first, last + 1))]
        shares = [(inside.take(end, axis).mean(), axis, end) for axis in range(3) for end in (0, -1)]
        share, axis, end = min(shares)
        if share >= FILLED:
            break
        if end == 0:
            first[axis] += 1
        else:
            last[axis] -= 1
    return first, last

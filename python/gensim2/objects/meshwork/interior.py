"""Find the free space in a container from its hulls. Criteria use it to decide whether an object is inside.

The last keypoint of a container is the measured point. The measured point lies in the space, or above it if objects are
dropped in. Its link is the link that contains objects: the moving link of a drawer, but the body of a box or a
refrigerator.

A grid covers the hulls of this link. A cell is free if it overlaps no hull and has a floor below and walls on at least
three sides. Three walls are enough, because a refrigerator is open in front. The result is a box along the axes of the
link with the connected free cells nearest to the measured point, up to the walls.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.spatial import ConvexHull

from gensim2.core.arrays import Array
from gensim2.objects.meshwork.crossings import HullsKey, crossings

CELL = 0.005
"""Edge length of a grid cell, m; for a link longer than ``CELLS`` cells, its longest side divided by ``CELLS``."""
CELLS = 64

WALLS = 3
"""Minimum number of the four sides of a free cell that must have a wall."""

NEAR = 0.03
"""Maximum horizontal distance (m) between the measured point and the free space."""

BELOW = 0.15
"""Maximum vertical distance (m) between the measured point and the free space."""

SMALLEST = 0.02
"""Minimum side length (m) of a free space; smaller spaces are ignored."""

FILLED = 0.5
"""Minimum fraction of free cells in an outer layer of the box; other outer layers are cut off."""


@dataclass(frozen=True)
class InnerBox:
    """A box along the axes of a link.

    Attributes:
        low, high: (3,) corners in the link frame, m.
    """

    low: Array
    high: Array

    def contains(self, point: Array) -> bool:
        """Return whether a point (3,) in the link frame is inside the box."""
        return bool(((self.low <= point) & (point <= self.high)).all())


def inner_box(hulls: tuple[Array, ...], measured_point: Array, up: Array) -> InnerBox | None:
    """Return the free space inside a link as a box. Return None if there is no free space near the measured point.

    Args:
        hulls: vertices (N, 3) in the link frame, m. Results are cached by the tuple object.
        measured_point: (3,) point in the link frame, m, that marks the free space: the last keypoint of the container.
        up: (3,) vertical direction in the link frame, which is rounded to the nearest axis of the frame.
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
    """Return a mask of the cells within half a cell of a hull. The margin ensures that thin walls are included."""
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
    """Move each side of the free box of grid cells to the nearest wall within two cells, or leave it."""
    corners = [box.low.copy(), box.high.copy()]
    spread = np.linspace(0.1, 0.9, 9)
    for axis in range(3):
        for corner, sign in zip(corners, (-1.0, 1.0), strict=True):
            shares = np.stack(np.meshgrid(*[spread] * 3, indexing="ij"), axis=-1)
            points = box.low + shares.take(0, axis).reshape(-1, 3) * (box.high - box.low)
            # Points at the centres of the cells in the outermost layer of this side.
            points[:, axis] = corner[axis] - sign * cell / 2
            enter, _ = crossings(hulls, points, sign * np.eye(3)[axis])
            to_wall = float(np.median(np.where(enter >= 0.0, enter, np.inf).min(axis=1))) - cell / 2
            if 0.0 < to_wall <= 2 * cell:
                corner[axis] += sign * to_wall
    return InnerBox(*corners)


def _behind(solid: npt.NDArray[np.bool_], axis: int, forwards: bool) -> npt.NDArray[np.bool_]:
    """Return a mask of the cells behind a solid cell along the axis.

    The solid cell has a lower index, or a higher one with ``forwards=False``.
    """
    turned = solid if forwards else np.flip(solid, axis)
    found = np.maximum.accumulate(turned, axis)
    return found if forwards else np.flip(found, axis)


def _walled(solid: npt.NDArray[np.bool_], up: int) -> npt.NDArray[np.bool_]:
    sides = [_behind(solid, axis, forwards) for axis in range(3) if axis != up for forwards in (True, False)]
    return np.asarray(np.sum(sides, axis=0) >= WALLS)


def _box(room: npt.NDArray[np.bool_]) -> tuple[npt.NDArray[np.int_], npt.NDArray[np.int_]]:
    """Return the first and last cells (3,) of the box of free cells. Outer layers with few free cells are left out."""
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

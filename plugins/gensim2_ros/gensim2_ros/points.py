"""Points of ``sensor_msgs/msg/PointCloud2`` and of ``octomap_msgs/msg/Octomap``."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np

from .poses import Array
from .refusals import ErrorCode, RefusedError

#: NumPy's types of ``sensor_msgs/msg/PointField``, by its constants.
TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
#: Number of levels of an octree: its root has 2**16 cells along each side.
DEPTH = 16


def _refused(field: str, message: str) -> RefusedError:
    return RefusedError(ErrorCode.INVALID_OBJECT_NAME, field, message)


def _bytes(data: Any, kind: str) -> bytes:
    """Return the bytes of a sequence of numbers of one byte each."""
    return data if isinstance(data, bytes) else np.asarray(data, dtype=kind).tobytes()


def cloud_points(message: Any) -> Array:
    """Return the finite points (N, 3) of a PointCloud2 in its own frame, m.

    Raises:
        RefusedError: x, y or z is missing, or the sizes do not fit each other.
    """
    fields = {field.name: field for field in message.fields}
    order, step = (">" if message.is_bigendian else "<"), int(message.point_step)
    data = np.frombuffer(_bytes(message.data, "u1"), dtype=np.uint8)
    height, width, row = int(message.height), int(message.width), int(message.row_step)
    if row < width * step or len(data) < height * row:
        raise _refused("data", f"has {len(data)} bytes for {height} rows of {row} bytes with {width} points of {step}")
    columns = []
    for name in ("x", "y", "z"):
        field = fields.get(name)
        kind = TYPES.get(int(field.datatype)) if field is not None else None
        if field is None or kind is None:
            raise _refused("fields", f"has no field {name!r} of a known type; it has {sorted(fields)}")
        offset, size = int(field.offset), np.dtype(kind).itemsize
        if offset + size > step:
            raise _refused("fields", f"field {name!r} ends at byte {offset + size} of points of {step} bytes")
        rows = data[: height * row].reshape(height, row)[:, : width * step].reshape(-1, step)
        columns.append(rows[:, offset : offset + size].copy().view(order + kind)[:, 0].astype(np.float64))
    points = np.column_stack(columns)
    return points[np.isfinite(points).all(axis=1)]


def occupied_cells(message: Any) -> tuple[Array, Array]:
    """Return the occupied cells of an Octomap: centres (N, 3) in the map's frame and side lengths (N,), m.

    A cell of a full map (``binary`` is false) is occupied if its probability is at least 0.5, OctoMap's default.

    Raises:
        RefusedError: the tree is of another class than OcTree, or its data end too early.
    """
    data = _bytes(message.data, "i1")
    if not data:
        # MoveIt clears its octomap with an empty one, whose id is "cleared".
        return np.zeros((0, 3)), np.zeros(0)
    resolution = float(message.resolution)
    if message.id != "OcTree":
        raise _refused("id", f"{message.id!r} cannot be read; publish an OcTree")
    if not (np.isfinite(resolution) and resolution > 0.0):
        raise _refused("resolution", f"{resolution} m must be above 0")
    try:
        found = _binary(data) if message.binary else _full(data)
    except (IndexError, struct.error) as error:
        raise _refused("data", f"ends after {len(data)} bytes, in the middle of the tree") from error
    cells = np.array(found, dtype=np.float64).reshape(-1, 4)
    return (cells[:, :3] - 2 ** (DEPTH - 1)) * resolution, cells[:, 3] * resolution


#: A cell: coordinates of its centre, measured in the smallest cells from the corner of the map, and its side length.
Cell = tuple[float, float, float, int]


def _child(cell: Cell, number: int) -> Cell:
    """Return an eighth of a cell: bit 0 of its number stands for x, bit 1 for y and bit 2 for z."""
    quarter = cell[3] / 4
    x, y, z = (cell[axis] + (quarter if number >> axis & 1 else -quarter) for axis in range(3))
    return x, y, z, cell[3] // 2


def _whole() -> Cell:
    return 2 ** (DEPTH - 1), 2 ** (DEPTH - 1), 2 ** (DEPTH - 1), 2**DEPTH


def _binary(data: bytes) -> list[Cell]:
    """Read a tree with two bits for each child: 0 unknown, 2 occupied, 1 free, 3 with children, as OctoMap stores bits
    from the lowest."""
    out: list[Cell] = []
    place = 0

    def read(cell: Cell) -> None:
        nonlocal place
        bits = data[place] | data[place + 1] << 8
        place += 2
        kinds = [bits >> 2 * k & 3 for k in range(8)]
        if cell[3] < 2:
            raise IndexError("a tree is deeper than 16 levels")
        out.extend(_child(cell, k) for k in range(8) if kinds[k] == 2)
        for k in range(8):
            if kinds[k] == 3:
                read(_child(cell, k))

    read(_whole())
    return out


def _full(data: bytes) -> list[Cell]:
    """Read a tree with the log-odds of each node and one bit for each child."""
    out: list[Cell] = []
    place = 0

    def read(cell: Cell) -> None:
        nonlocal place
        odds, children = struct.unpack_from("<fB", data, place)
        place += 5
        if not children:
            if odds >= 0.0:
                out.append(cell)
            return
        if cell[3] < 2:
            raise IndexError("a tree is deeper than 16 levels")
        for k in range(8):
            if children >> k & 1:
                read(_child(cell, k))

    read(_whole())
    return out

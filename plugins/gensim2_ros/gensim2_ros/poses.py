"""Poses of messages as (4, 4) matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from .refusals import ErrorCode, RefusedError

Array = npt.NDArray[np.float64]
#: Largest accepted deviation of a quaternion's length from 1.
UNIT = 1e-3


def vector(message: Any, field: str) -> Array:
    """Return the coordinates (3,) of a Point or Vector3, m."""
    xyz = np.array([message.x, message.y, message.z], dtype=np.float64)
    if not np.isfinite(xyz).all():
        raise RefusedError(ErrorCode.FRAME_TRANSFORM_FAILURE, field, f"{xyz.tolist()} is not finite")
    return xyz


def rotation(message: Any, field: str) -> Array:
    """Return the rotation matrix (3, 3) of a Quaternion. All zeros stand for the identity, as in MoveIt."""
    x, y, z, w = (float(message.x), float(message.y), float(message.z), float(message.w))
    norm = float(np.sqrt(x * x + y * y + z * z + w * w))
    if norm == 0.0:
        return np.eye(3)
    if not abs(norm - 1.0) <= UNIT:
        raise RefusedError(
            ErrorCode.FRAME_TRANSFORM_FAILURE, field, f"the quaternion has the length {norm:.4g}; normalize it"
        )
    x, y, z, w = x / norm, y / norm, z / norm, w / norm
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def rigid(turn: Array, origin: Array) -> Array:
    """Return the pose (4, 4) of a rotation (3, 3) and an origin (3,)."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = turn, origin
    return out


def matrix(message: Any, field: str) -> Array:
    """Return the matrix (4, 4) of a Pose."""
    turn = rotation(message.orientation, f"{field}.orientation")
    return rigid(turn, vector(message.position, f"{field}.position"))


def transform(message: Any, field: str) -> Array:
    """Return the matrix (4, 4) of a Transform."""
    turn = rotation(message.rotation, f"{field}.rotation")
    return rigid(turn, vector(message.translation, f"{field}.translation"))


def inverse(pose: Array) -> Array:
    """Return the inverse of a rigid transform (4, 4)."""
    return rigid(pose[:3, :3].T, -pose[:3, :3].T @ pose[:3, 3])


def about(axis: int, angle: float) -> Array:
    """Return the rotation (3, 3) by ``angle`` (rad) about axis 0, 1 or 2."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out = np.eye(3)
    out[i, i], out[i, j], out[j, i], out[j, j] = c, -s, s, c
    return out

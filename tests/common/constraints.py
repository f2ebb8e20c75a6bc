"""Constraints of keypoint configs that several tests use."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


def parallel(
    start: str, end: str, axis: Sequence[float], tolerance: float, *, inner_product: float = 1.0
) -> dict[str, Any]:
    """Return the constraint that the line between two tool keypoints is parallel to a world axis, within a tolerance
    (rad).
    """
    return {
        "type": "frame_axis_parallel",
        "axis_from_keypoint_name": start,
        "axis_to_keypoint_name": end,
        "target_axis": list(axis),
        "target_axis_frame": "world",
        "target_inner_product": inner_product,
        "tolerance": tolerance,
    }


def pointing_down(tolerance: float) -> dict[str, Any]:
    """Return the constraint that the fingers point down, within a tolerance (rad)."""
    return parallel("tool_tail", "tool_head", [0.0, 0.0, -1.0], tolerance)


def point_to_point(tool: str, target: str, tolerance: float, **fields: Any) -> dict[str, Any]:
    """Return the constraint that a tool keypoint is at an object keypoint, within a tolerance (m)."""
    return {
        "type": "point2point_constraint",
        "keypoint_name": tool,
        "target_keypoint_name": target,
        **fields,
        "tolerance": tolerance,
    }

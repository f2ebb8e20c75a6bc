"""Define the names of frame columns in observation files, zarr exports and LeRobot exports.

| observation file | column, and array in zarr | LeRobot |
|---|---|---|
| ``proprioception/*`` | ``state``, ``velocity``, ``tool_pose``, ``gripper`` | ``observation.*`` |
| none | ``action`` | ``action`` |
| none | ``reward``, ``success``, ``done`` | ``next.*`` |
| ``pointcloud/xyz``, ``pointcloud/rgb`` | ``point_cloud`` | ``observation.points`` |
| ``pointcloud/xyz`` of keypoints | ``environment_state`` | ``observation.environment_state`` |
| ``cameras/<camera>/rgb`` | ``image_<camera>`` | ``observation.images.<camera>`` |
| ``cameras/<camera>/depth``, ``segmentation`` | ``depth_<camera>``, ``segmentation_<camera>`` | none |
| ``pointcloud/segmentation`` | ``point_segmentation`` | none |

An asterisk in the table stands for any name in the middle column of the row. Actions, rewards, ``success`` and ``done``
come from the recorded episode. Names have no slash, because other tools interpret a slash as a folder.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy.typing as npt

from gensim2.core.foreign.names import checked_name
from gensim2.perception.observation import (
    CLOUD,
    CLOUD_SEGMENTATION,
    DEPTH,
    ENVIRONMENT_STATE,
    GRIPPER,
    IMAGE,
    SEGMENTATION,
    STATE,
    TOOL_POSE,
    VELOCITY,
    cloud_column,
)

XYZ, RGB, IDS = "pointcloud/xyz", "pointcloud/rgb", "pointcloud/segmentation"
"""Cloud arrays of observation files: positions (N, 3) int16 in 0.1 mm, colours (N, 3) uint8, and ids (N,) int16."""
STORED = {
    STATE: "proprioception/qpos",
    VELOCITY: "proprioception/qvel",
    TOOL_POSE: "proprioception/tool_pose",
    GRIPPER: "proprioception/gripper",
}
"""Proprioception arrays in observation files, by column."""

_CAMERAS = "cameras"
_PREFIXES = {"rgb": IMAGE, "depth": DEPTH, "segmentation": SEGMENTATION}
_LEROBOT = {
    STATE: "observation.state",
    VELOCITY: "observation.velocity",
    TOOL_POSE: "observation.tool_pose",
    GRIPPER: "observation.gripper",
    "action": "action",
    CLOUD: "observation.points",
    ENVIRONMENT_STATE: "observation.environment_state",
    "reward": "next.reward",
    "success": "next.success",
    "done": "next.done",
}
_LEROBOT_IMAGES = "observation.images."


def camera_array(camera: str, what: str) -> str:
    """Return the name of a camera's array in an observation file, such as ``cameras/left/rgb``."""
    return f"{_CAMERAS}/{checked_name(camera, field='camera')}/{what}"


def column_of(array: str) -> str | None:
    """Return the name of the column to which an array of a camera is exported; None if the array is not exported.

    Raises:
        InputError: the camera's name is invalid.
    """
    folder, _, rest = array.partition("/")
    camera, _, what = rest.rpartition("/")
    if folder != _CAMERAS or what not in _PREFIXES:
        return None
    return _PREFIXES[what] + checked_name(camera, field=array)


def seen_columns(arrays: Mapping[str, npt.NDArray[Any]], *, known: bool = False) -> dict[str, npt.NDArray[Any]]:
    """Convert the arrays of an observation file, except proprioception, to columns.

    Args:
        arrays: arrays by name; ``pointcloud/xyz`` in m.
        known: whether the points are the simulator's keypoints, exported as ``environment_state`` instead of a cloud.
    """
    found: dict[str, npt.NDArray[Any]] = {}
    if (points := arrays.get(XYZ)) is not None:
        if known:
            found[ENVIRONMENT_STATE] = points.reshape(len(points), -1)
        else:
            found[CLOUD] = cloud_column(points, arrays.get(RGB))
    if not known and (ids := arrays.get(IDS)) is not None:
        found[CLOUD_SEGMENTATION] = ids
    return found | {column: values for name, values in arrays.items() if (column := column_of(name)) is not None}


def array_of(column: str) -> str | None:
    """Return the camera array of an exported column, such as ``cameras/left/rgb``, or None if the column has no
    camera.
    """
    for what, prefix in _PREFIXES.items():
        if column.startswith(prefix):
            return camera_array(column.removeprefix(prefix), what)
    return None


def lerobot_name(column: str) -> str | None:
    """Return LeRobot's name of a column; None for depth and segmentation, which LeRobot cannot store."""
    if column.startswith(IMAGE):
        return _LEROBOT_IMAGES + column.removeprefix(IMAGE)
    return _LEROBOT.get(column)


def column_in_lerobot(name: str) -> str | None:
    """Return the column of a LeRobot feature; None for unknown features."""
    if name.startswith(_LEROBOT_IMAGES):
        return IMAGE + current(name.removeprefix(_LEROBOT_IMAGES))
    return next((column for column, theirs in _LEROBOT.items() if theirs == name), None)


def current(camera: str) -> str:
    """Return the current name of a camera. Old exports have names such as ``cameras/left``."""
    return camera.removeprefix(f"{_CAMERAS}/")


def formerly_nested(group: str) -> str | None:
    """Return the current prefix for a group of old zarr exports, or None for other groups.

    The group ``image_cameras`` has the prefix ``image_``.
    """
    return next((prefix for prefix in (IMAGE, DEPTH) if group == f"{prefix}{_CAMERAS}"), None)

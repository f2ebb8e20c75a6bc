"""Names of what frames hold, made in one place: in observation files, in zarr, in LeRobot, and back.

| observation file | column, and array in zarr | LeRobot |
|---|---|---|
| ``proprioception/*`` | ``state``, ``velocity``, ``tool_pose``, ``gripper`` | ``observation.*`` |
| | ``action`` | ``action`` |
| | ``reward``, ``success``, ``done`` | ``next.*`` |
| ``pointcloud/xyz``, ``pointcloud/rgb`` | ``point_cloud`` | ``observation.points`` |
| ``pointcloud/xyz`` of keypoints | ``environment_state`` | ``observation.environment_state`` |
| ``cameras/<camera>/rgb`` | ``image_<camera>`` | ``observation.images.<camera>`` |
| ``cameras/<camera>/depth``, ``segmentation`` | ``depth_<camera>``, ``segmentation_<camera>`` | none |
| ``pointcloud/segmentation`` | ``point_segmentation`` | none |

No name holds a slash: LeRobot's editing tools and Diffusion Policy's replay buffer take one for a folder.
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
"""Arrays of clouds in files of observations: (N, 3) int16 in steps of 0.1 mm; (N, 3) uint8; (N,) int16."""
STORED = {
    STATE: "proprioception/qpos",
    VELOCITY: "proprioception/qvel",
    TOOL_POSE: "proprioception/tool_pose",
    GRIPPER: "proprioception/gripper",
}
"""Arrays of what the robot knows of itself in files of observations, by column."""

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
    """Name of a camera's array in a file of observations: ``what`` is ``rgb``, ``depth``, ``segmentation``, ..."""
    return f"{_CAMERAS}/{checked_name(camera, field='camera')}/{what}"


def column_of(array: str) -> str | None:
    """The column that a camera's array becomes; None where it becomes none.

    Raises:
        InputError: the camera's name is none.
    """
    folder, _, rest = array.partition("/")
    camera, _, what = rest.rpartition("/")
    if folder != _CAMERAS or what not in _PREFIXES:
        return None
    return _PREFIXES[what] + checked_name(camera, field=array)


def seen_columns(arrays: Mapping[str, npt.NDArray[Any]], *, known: bool = False) -> dict[str, npt.NDArray[Any]]:
    """Return the columns that the arrays of a file of observations become, those of proprioception apart.

    Args:
        arrays: by name; ``pointcloud/xyz`` in m.
        known: the cloud is made of keypoints, and becomes the state of the environment.
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
    """The camera's array that becomes a column; None of other columns."""
    for what, prefix in _PREFIXES.items():
        if column.startswith(prefix):
            return camera_array(column.removeprefix(prefix), what)
    return None


def lerobot_name(column: str) -> str | None:
    """Name of a column in LeRobot's data sets; None of depth and ids, for which they have no place."""
    if column.startswith(IMAGE):
        return _LEROBOT_IMAGES + column.removeprefix(IMAGE)
    return _LEROBOT.get(column)


def column_in_lerobot(name: str) -> str | None:
    """The column that a feature of LeRobot is; None where it is none of ours."""
    if name.startswith(_LEROBOT_IMAGES):
        return IMAGE + current(name.removeprefix(_LEROBOT_IMAGES))
    return next((column for column, theirs in _LEROBOT.items() if theirs == name), None)


def current(camera: str) -> str:
    """A camera's name as it is written now: exports were once written with ``cameras/left`` for ``left``."""
    return camera.removeprefix(f"{_CAMERAS}/")


def formerly_nested(group: str) -> str | None:
    """Return what precedes a camera's name in the columns of a group in zarr's ``data``, as old exports have them."""
    return next((prefix for prefix in (IMAGE, DEPTH) if group == f"{prefix}{_CAMERAS}"), None)

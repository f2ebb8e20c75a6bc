"""What the columns of frames are called in LeRobot's data sets, there and back."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from gensim2.data.formats.frames import Array, Frames
from gensim2.data.formats.lerobot import Feature, LeRobotWriter
from gensim2.data.formats.lerobot_reading import read_lerobot
from gensim2.observations.columns import (
    CLOUD,
    CLOUD_SEGMENTATION,
    DEPTH,
    GRIPPER,
    IMAGE,
    SEGMENTATION,
    STATE,
    TOOL_POSE,
    VELOCITY,
)
from gensim2.robots import RobotProfile

_NAMES = {
    STATE: "observation.state",
    VELOCITY: "observation.velocity",
    TOOL_POSE: "observation.tool_pose",
    GRIPPER: "observation.gripper",
    "action": "action",
    CLOUD: "observation.points",
    "reward": "next.reward",
    "success": "next.success",
    "done": "next.done",
}
_IMAGES = "observation.images."
_NOT_HERE = (DEPTH, SEGMENTATION, CLOUD_SEGMENTATION)
"""Beginnings of columns for which LeRobot has no place."""


def export_lerobot(episodes: Iterator[Frames], out: Path, profile: RobotProfile) -> None:
    """Write episodes as a LeRobot data set.

    Args:
        episodes: at least one, all with the same columns; depth and segmentation, for which
            LeRobot has no place, are left out.
        out: folder.
        profile: of the robot.

    Raises:
        InputError: episodes differ in their columns.
        MissingExtraError: pyarrow is not installed.
    """
    joints = profile.model.joint_names
    names: dict[str, Sequence[str]] = {
        STATE: joints,
        VELOCITY: joints,
        TOOL_POSE: ("x", "y", "z", "qw", "qx", "qy", "qz"),
        GRIPPER: ("width", "command"),
        "action": (*profile.arm_joints, "gripper"),
    }
    writer: LeRobotWriter | None = None
    for frames in episodes:
        columns = {name: values for name, values in frames.columns.items() if not name.startswith(_NOT_HERE)}
        if writer is None:
            features = {_name(name): _feature(name, values, names.get(name)) for name, values in columns.items()}
            writer = LeRobotWriter(out, features, fps=profile.control_hz, robot=profile.name)
        shaped = {_name(name): values if values.ndim > 1 else values[:, None] for name, values in columns.items()}
        writer.add(frames.sentence, shaped)
    if writer is not None:
        writer.finish()


def lerobot_frames(root: Path) -> Iterator[Frames]:
    """Yield the episodes of a LeRobot data set, without pictures, under our names.

    Raises:
        InputError: it is no LeRobot data set of this version.
        MissingExtraError: pyarrow is not installed.
    """
    ours = {theirs: name for name, theirs in _NAMES.items()}
    for sentence, columns in read_lerobot(root):
        known = {ours[name]: values for name, values in columns.items() if name in ours}
        yield Frames(sentence, known)


def _name(name: str) -> str:
    return _IMAGES + name.removeprefix(IMAGE) if name.startswith(IMAGE) else _NAMES[name]


def _feature(name: str, values: Array, names: Sequence[str] | None) -> Feature:
    if name.startswith(IMAGE):
        return Feature("video", values.shape[1:], ("height", "width", "channels"))
    if name == CLOUD:
        names = ("point", "x y z red green blue" if values.shape[-1] == 6 else "x y z")
    return Feature(values.dtype.name, values.shape[1:] or (1,), names)

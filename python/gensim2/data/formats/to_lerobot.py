"""Convert frames to a LeRobot data set and back."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from gensim2.data.formats.columns import column_in_lerobot, lerobot_name
from gensim2.data.formats.frames import Array, Frames
from gensim2.data.formats.lerobot import Feature, LeRobotWriter
from gensim2.data.formats.lerobot_reading import read_lerobot
from gensim2.perception.observation import CLOUD, GRIPPER, IMAGE, STATE, TOOL_POSE, VELOCITY
from gensim2.robots import RobotProfile


def export_lerobot(episodes: Iterator[Frames], out: Path, profile: RobotProfile) -> None:
    """Write episodes as a LeRobot data set. Depth and segmentation are left out, because LeRobot cannot store them.

    Args:
        episodes: frames of each episode. There must be at least one episode, and all must have the same columns.
        out: new or empty output folder.

    Raises:
        InputError: episodes have different columns.
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
        columns = {theirs: name for name in frames.columns if (theirs := lerobot_name(name)) is not None}
        if writer is None:
            features = {
                theirs: _feature(name, frames.columns[name], names.get(name)) for theirs, name in columns.items()
            }
            writer = LeRobotWriter(out, features, fps=profile.control_hz, robot=profile.name)
        shaped = {theirs: frames.columns[name] for theirs, name in columns.items()}
        writer.add(frames.sentence, {name: v if v.ndim > 1 else v[:, None] for name, v in shaped.items()})
    if writer is not None:
        writer.finish()


def lerobot_frames(root: Path) -> Iterator[Frames]:
    """Yield the episodes of a LeRobot data set, without images. Columns have the names that gensim2 uses.

    Raises:
        InputError: the folder is not a LeRobot data set of this version.
        MissingExtraError: pyarrow is not installed.
    """
    for sentence, columns in read_lerobot(root):
        named = {column_in_lerobot(name): values for name, values in columns.items()}
        yield Frames(sentence, {name: values for name, values in named.items() if name is not None})


def _feature(name: str, values: Array, names: Sequence[str] | None) -> Feature:
    if name.startswith(IMAGE):
        return Feature("video", values.shape[1:], ("height", "width", "channels"))
    if name == CLOUD:
        names = ("point", "x y z red green blue" if values.shape[-1] == 6 else "x y z")
    return Feature(values.dtype.name, values.shape[1:] or (1,), names)

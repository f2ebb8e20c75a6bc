"""An episode as policies learn from it: what was seen, what was done, frame by frame. Every format writes these."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.robots import RobotProfile
from gensim2.rollout.recording import Recording

Array = npt.NDArray[Any]

CONTROL_STEPS_PER_SECOND = 20
FIRST_JOINT = 13
"""Column of the first joint in ManiSkill's states: before it the root's pose (7) and velocities (6)."""

CLOUD, IMAGE, DEPTH = "point_cloud", "image_", "depth_"
"""Names of observations, the last two before a camera's."""


@dataclass(frozen=True)
class Frames:
    """T frames of one episode; frame t is what was seen when the action t was taken.

    Attributes:
        sentence: what was to be done.
        columns: (T, ...) by name: ``state`` (n float32, all active joints of the robot, rad or m), ``action`` (m + 1
            float32, targets of the arm's joints, and the gripper from -1 to 1), ``reward`` (float32, 1 where the goal
            holds after the action), ``success``, ``done`` (bool), and the observations that were made:
            ``point_cloud`` (N, 3 or 6 float32, x y z in the robot's base frame, m, then red, green, blue from 0 to 1),
            ``image_<camera>`` (H, W, 3 uint8), ``depth_<camera>`` (H, W uint16, mm).
    """

    sentence: str
    columns: dict[str, Array]


def frames_of(
    recording: Recording, profile: RobotProfile, sentence: str, observation: Mapping[str, Array] | None = None
) -> Frames:
    """Return the frames of a recorded episode.

    Args:
        observation: (T + 1, ...) arrays of its file of observations (docs/data.md); the last belongs to no action.
    """
    steps = recording.steps
    robot = recording.env_states["articulations"][profile.agent]
    joints = len(profile.model.joint_names)
    seen = {} if observation is None else _seen(observation)
    return Frames(
        sentence,
        {
            "state": np.ascontiguousarray(robot[:steps, FIRST_JOINT : FIRST_JOINT + joints]),
            "action": recording.actions,
            "reward": recording.rewards,
            "success": recording.success,
            "done": np.arange(steps) == steps - 1,
            **{name: values[:steps] for name, values in seen.items()},
        },
    )


def _seen(observation: Mapping[str, Array]) -> dict[str, Array]:
    found: dict[str, Array] = {}
    if (points := observation.get("pointcloud/xyz")) is not None:
        colours = observation.get("pointcloud/rgb")
        parts: list[Array] = [points.astype(np.float32)]
        if colours is not None:
            parts.append(colours.astype(np.float32) / 255)
        found[CLOUD] = np.concatenate(parts, axis=-1)
    for name, values in observation.items():
        camera, _, what = name.rpartition("/")
        if camera != "pointcloud" and what in ("rgb", "depth"):
            found[(IMAGE if what == "rgb" else DEPTH) + camera] = values
    return found

"""Convert an episode to frames for the frame-based export formats. A frame is an observation with an action."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import InputError
from gensim2.data.formats.columns import seen_columns
from gensim2.perception.observation import PROPRIOCEPTION, Proprioception
from gensim2.robots import OPEN, RobotProfile
from gensim2.rollout.recording import Recording

Array = npt.NDArray[Any]

FIRST_JOINT = 13
"""Column of the first joint in ManiSkill's states, after the root's pose (7) and velocities (6)."""

EPISODE_COLUMNS = ("state", "action", "reward", "success", "done")
"""Columns that are computed from an episode; an import compares them with the original episodes in an export."""


@dataclass(frozen=True)
class Frames:
    """T frames of one episode; frame t has the observation before action t.

    Attributes:
        sentence: instruction of the task.
        columns: arrays (T, ...) by name. ``action`` (float32) has the m arm targets and the gripper command from -1 to
            1, without added noise. ``reward`` (float32) is 1 if the goal is reached; ``success`` and ``done`` are bool.
            Other columns have the names of :mod:`gensim2.perception.observation`.
    """

    sentence: str
    columns: dict[str, Array]


def frames_of(
    recording: Recording,
    profile: RobotProfile,
    sentence: str,
    observation: Mapping[str, Array] | None = None,
    *,
    known: bool = False,
) -> Frames:
    """Return the frames of a recorded episode.

    Args:
        observation: (T + 1, ...) arrays of the observation file. The last row has no action and is dropped.
        known: whether the point cloud consists of keypoints; such a cloud becomes ``environment_state``.

    Raises:
        InputError: the episode was recorded with another robot, or its observations have a wrong number of steps.
    """
    steps = recording.steps
    states = recording.env_states.get("articulations", {}).get(profile.agent)
    joints = len(profile.model.joint_names)
    if states is None or states.shape[1] != FIRST_JOINT + 2 * joints:
        wrong = f"the recorded states do not fit the robot {profile.name}, or are missing"
        raise InputError(wrong, field=f"articulations.{profile.agent}")
    if recording.actions.shape[1] != len(profile.arm_joints) + 1:
        raise InputError(
            f"has {recording.actions.shape[1]} numbers per step, but the robot {profile.name} needs "
            f"{len(profile.arm_joints) + 1}",
            field="actions",
        )
    own: dict[str, list[Array]] = {name: [] for name in PROPRIOCEPTION}
    for step in range(steps):
        positions, velocities = np.split(states[step, FIRST_JOINT : FIRST_JOINT + 2 * joints], 2)
        command = float(recording.actions[step - 1, -1]) if step else OPEN
        for name, row in Proprioception(profile, positions, velocities, command).items():
            own[name].append(row)
    seen = {} if observation is None else seen_columns(observation, known=known)
    for name, values in seen.items():
        if len(values) != steps + 1:
            raise InputError(f"has {len(values)} frames, but the episode has {steps} steps", field=name)
    return Frames(
        sentence,
        {
            **{name: np.stack(rows) for name, rows in own.items()},
            "action": recording.meant,
            "reward": recording.rewards,
            "success": recording.success,
            "done": np.arange(steps) == steps - 1,
            **{name: values[:steps] for name, values in seen.items()},
        },
    )

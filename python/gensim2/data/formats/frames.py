"""An episode as policies learn from it: what was seen, what was done, frame by frame. Every format writes these."""

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
"""Column of the first joint in ManiSkill's states: before it the root's pose (7) and velocities (6)."""

EPISODE_COLUMNS = ("state", "action", "reward", "success", "done")
"""Columns that are an episode's own numbers; an import compares them with the episodes beside an export."""


@dataclass(frozen=True)
class Frames:
    """T frames of one episode; frame t is what was seen when the action t was taken.

    Attributes:
        sentence: what was to be done.
        columns: (T, ...) by name: ``action`` (m + 1 float32, targets of the arm's joints, and the gripper from -1 to
            1; what was meant, where noise was on what was sent), ``reward`` (float32, 1 where the goal holds after
            the action), ``success``, ``done`` (bool), and what is seen, by the names of
            :mod:`gensim2.perception.observation`.
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
        observation: (T + 1, ...) arrays of its file of observations; the last belongs to no action.
        known: its cloud is made of keypoints, and is told as the state of the environment.

    Raises:
        InputError: it is of another robot, or its observations are not of its steps.
    """
    steps = recording.steps
    states = recording.env_states.get("articulations", {}).get(profile.agent)
    joints = len(profile.model.joint_names)
    if states is None or states.shape[1] != FIRST_JOINT + 2 * joints:
        raise InputError(f"holds no states of the robot {profile.name}", field=f"articulations.{profile.agent}")
    if recording.actions.shape[1] != len(profile.arm_joints) + 1:
        raise InputError(f"has {recording.actions.shape[1]} numbers, not those of {profile.name}", field="actions")
    own: dict[str, list[Array]] = {name: [] for name in PROPRIOCEPTION}
    for step in range(steps):
        positions, velocities = np.split(states[step, FIRST_JOINT : FIRST_JOINT + 2 * joints], 2)
        command = float(recording.actions[step - 1, -1]) if step else OPEN
        for name, row in Proprioception(profile, positions, velocities, command).items():
            own[name].append(row)
    seen = {} if observation is None else seen_columns(observation, known=known)
    for name, values in seen.items():
        if len(values) != steps + 1:
            raise InputError(f"has {len(values)} frames of an episode of {steps} steps", field=name)
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

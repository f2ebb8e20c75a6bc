"""Check that a policy controls the same robot for which it was trained."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gensim2.perception.observation import STATE, TOOL_POSE, tool_pose
from gensim2.policy.checkpoint import CheckpointError
from gensim2.robots import robot

if TYPE_CHECKING:
    from gensim2.perception import Observation

FARTHEST = 0.02
"""Maximum distance (m) between the observed tool position and the position computed for the policy's robot."""


def check_robot(name: str, observation: Observation, folder: Path) -> None:
    """Check that the observed tool position matches the kinematics of the robot that the policy was trained for.

    Args:
        name: name of the policy's robot.
        observation: observation of the robot that the policy is to control.
        folder: folder of the checkpoint, for the message.

    Raises:
        CheckpointError: the tool positions or the numbers of joints differ.
    """
    profile = robot(name)
    state: Any = np.asarray(observation[STATE], dtype=np.float32)
    expected = len(profile.reset_qpos)
    remedy = f"use --robot {name}"
    if state.shape != (expected,):
        message = f"is for the robot {name!r} with {expected} joints, this one has {len(state)}"
        raise CheckpointError(message, file=folder, field="robot", remedy=remedy)
    off = np.linalg.norm(tool_pose(profile, state)[:3] - np.asarray(observation[TOOL_POSE])[:3])
    if off > FARTHEST:
        message = f"is for the robot {name!r}: the tool of this one stands {off:.2f} m off"
        raise CheckpointError(message, file=folder, field="robot", remedy=remedy)

"""Provide a controller that does not move, for control experiments."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gensim2.perception import Observation
from gensim2.robots import OPEN
from gensim2.rollout.controller import PROPRIOCEPTIVE

STEPS = 20
"""Number of control steps before the episode ends."""


class NoOpPolicy:
    """Keeps the arm at its initial joints and the fingers open.

    Args:
        arm: number of the arm's joints.
    """

    observation_spec = PROPRIOCEPTIVE

    def __init__(self, arm: int) -> None:
        self._arm = arm

    def reset(self, observation: Observation, seed: int) -> None:
        self._action = np.append(observation.joint_positions[: self._arm], OPEN).astype(np.float32)
        self._left = STEPS

    def act(self, observation: Observation) -> npt.NDArray[np.float32] | None:
        self._left -= 1
        return self._action if self._left >= 0 else None

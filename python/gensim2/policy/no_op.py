"""Controller that does nothing, as a control."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gensim2.perception import Observation
from gensim2.robots import OPEN
from gensim2.rollout.controller import PROPRIOCEPTIVE

STEPS = 20
"""Control steps for which it holds the arm before it is done."""


class NoOpPolicy:
    """Holds the arm where an episode begins, with open fingers.

    Args:
        arm: number of the arm's joints.
    """

    observation_spec = PROPRIOCEPTIVE

    def __init__(self, arm: int) -> None:
        self._arm = arm

    def reset(self, observation: Observation, seed: int) -> None:
        """Begin an episode."""
        self._action = np.append(observation.joint_positions[: self._arm], OPEN).astype(np.float32)
        self._left = STEPS

    def act(self, observation: Observation) -> npt.NDArray[np.float32] | None:
        """The same action always; None at the end."""
        self._left -= 1
        return self._action if self._left >= 0 else None

"""Further attempts of a closed-loop policy: a hand that is stuck retraces its path and starts again."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import InputError
from gensim2.perception import Observation
from gensim2.perception.observation import GRIPPER
from gensim2.policy.augment import holds
from gensim2.robots import RobotProfile

Action = npt.NDArray[np.float32]

ATTEMPTS = 4
"""Number of attempts in an episode, by default."""
STILL, STILL_SECONDS = 0.02, 1.5
"""Largest change of a joint target (rad) or of the gripper command that counts as no motion, and the time without
motion (s) after which the hand counts as stuck: more than twice the time that fingers take to close."""
RESTS = 6
"""Control steps at rest at the start of the path before another attempt."""


class Attempts:
    """Record of the actions of an episode, which says when another attempt is due.

    Args:
        profile: the robot.
        max_attempts: number of attempts in an episode, the first included.
    """

    def __init__(self, profile: RobotProfile, max_attempts: int) -> None:
        self._arm, self._patience, self._max = profile.arm_size, profile.steps(STILL_SECONDS), max_attempts
        self._way: list[Action] = []  # path of the arm since the attempt started
        self._last: Action | None = None
        self._begun, self._still, self._backs_off = 1, 0, False

    @staticmethod
    def check(max_attempts: int) -> None:
        """Refuse a number of attempts that is out of range.

        Raises:
            InputError: it does not lie in 1..1000.
        """
        if not 1 <= max_attempts <= 1000:
            raise InputError(f"must lie in 1..1000, is {max_attempts}", field="attempts")

    def is_due(self, observation: Observation) -> bool:
        """Whether the hand is stuck and holds nothing, and an attempt is left."""
        width, command = np.asarray(observation[GRIPPER])
        waits = self._still >= self._patience and len(self._way) > RESTS
        return waits and self._begun < self._max and not holds(width, command)

    def again(self) -> list[Action]:
        """Start another attempt: return the actions that retrace the path backwards, (m + 1,) each, gripper unchanged
        until the start is reached.
        """
        assert self._last is not None
        begin = self._way[0]
        back = [np.append(each[: self._arm], self._last[self._arm]).astype(np.float32) for each in self._way[::-1]]
        self._way, self._backs_off = [], True
        self._begun, self._still = self._begun + 1, 0
        return [*back, *[begin] * RESTS]

    def goes_on(self) -> None:
        """Treat the actions that follow as the policy's own, not as a way back."""
        self._backs_off = False

    def follow(self, action: Action) -> None:
        """Count the steps without motion by the commanded targets: a hand that presses never reaches its own."""
        last = self._last
        moves = last is None or bool(np.abs(action[: self._arm] - last[: self._arm]).max() > STILL)
        if not moves and last is not None and abs(float(action[self._arm] - last[self._arm])) <= STILL:
            self._still += 1
            return
        self._still, self._last = 0, action
        if moves and not self._backs_off:
            self._way.append(action)

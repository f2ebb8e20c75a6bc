"""Retry within an episode: a stuck hand retraces its path to the start pose, and the policy makes another attempt."""

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
"""Default number of attempts in an episode."""
STILL, STILL_SECONDS = 0.02, 1.5
"""The hand counts as stuck after ``STILL_SECONDS`` seconds in which no joint target (rad) and no gripper command
changed by more than ``STILL``. Closing the fingers takes less than half of this time.
"""
RESTS = 6
"""Number of control steps for which the arm waits at the start pose before the next attempt."""


class Attempts:
    """Records the actions of an episode and decides when to start another attempt.

    Args:
        max_attempts: maximum number of attempts in an episode, including the first attempt.
    """

    def __init__(self, profile: RobotProfile, max_attempts: int) -> None:
        self._arm, self._patience, self._max = profile.arm_size, profile.steps(STILL_SECONDS), max_attempts
        self._way: list[Action] = []  # the arm's path in this attempt
        self._last: Action | None = None
        self._begun, self._still, self._backs_off = 1, 0, False

    @staticmethod
    def check(max_attempts: int) -> None:
        """Check the number of attempts.

        Raises:
            InputError: ``max_attempts`` is outside 1..1000.
        """
        if not 1 <= max_attempts <= 1000:
            raise InputError(f"must lie in 1..1000, but is {max_attempts}", field="attempts")

    def is_due(self, observation: Observation) -> bool:
        """Return whether the hand is stuck without a grasped object and another attempt is allowed."""
        width, command = np.asarray(observation[GRIPPER])
        waits = self._still >= self._patience and len(self._way) > RESTS
        return waits and self._begun < self._max and not holds(width, command)

    def again(self) -> list[Action]:
        """Start another attempt, and return the actions (m + 1,) that retrace the hand's path to the start pose.

        On the way back the gripper keeps its last command; at the start pose it gets its initial command.
        """
        assert self._last is not None
        begin = self._way[0]
        back = [np.append(each[: self._arm], self._last[self._arm]).astype(np.float32) for each in self._way[::-1]]
        self._way, self._backs_off = [], True
        self._begun, self._still = self._begun + 1, 0
        return [*back, *[begin] * RESTS]

    def goes_on(self) -> None:
        """Start to record the path of a new attempt. Call this method when the hand has returned to the start pose."""
        self._backs_off = False

    def follow(self, action: Action) -> None:
        """Record an action, and count consecutive steps without motion.

        Motion is judged by the commanded targets, because an arm that presses against an object never reaches them.
        """
        last = self._last
        moves = last is None or bool(np.abs(action[: self._arm] - last[: self._arm]).max() > STILL)
        if not moves and last is not None and abs(float(action[self._arm] - last[self._arm])) <= STILL:
            self._still += 1
            return
        self._still, self._last = 0, action
        if moves and not self._backs_off:
            self._way.append(action)

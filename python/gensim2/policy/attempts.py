"""Second attempts of a closed-loop policy: a hand that is stuck goes back the way it came and begins again."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gensim2.errors import InputError
from gensim2.observations import Observation
from gensim2.observations.columns import GRIPPER
from gensim2.policy.augment import holds
from gensim2.robots import RobotProfile

Action = npt.NDArray[np.float32]

ATTEMPTS = 4
"""Times that a policy begins, by default."""
STILL, STILL_SECONDS = 0.02, 1.5
"""Rad within which targets are the same, and for how long they are, and the fingers' command, before a hand counts as
stuck: more than twice what fingers take."""
RESTS = 6
"""Control steps at rest before it begins again."""


class Attempts:
    """Follows the actions of an episode, and says when another attempt is due.

    Args:
        profile: the robot.
        max_attempts: times that a policy begins.
    """

    def __init__(self, profile: RobotProfile, max_attempts: int) -> None:
        self._arm, self._patience, self._max = profile.arm_size, profile.steps(STILL_SECONDS), max_attempts
        self._way: list[Action] = []  # that the arm came since it began
        self._last: Action | None = None
        self._begun, self._still, self._backs_off = 1, 0, False

    @staticmethod
    def check(max_attempts: int) -> None:
        """Refuse a number of attempts that cannot be.

        Raises:
            InputError: it is none of 1..1000.
        """
        if not 1 <= max_attempts <= 1000:
            raise InputError(f"must lie in 1..1000, is {max_attempts}", field="attempts")

    def is_due(self, observation: Observation) -> bool:
        """Whether the hand is stuck, holds nothing, and may begin again."""
        width, command = np.asarray(observation[GRIPPER])
        waits = self._still >= self._patience and len(self._way) > RESTS
        return waits and self._begun < self._max and not holds(width, command)

    def again(self) -> list[Action]:
        """Begin again: return the way that the arm came, backwards, with the fingers as they are until it is there."""
        assert self._last is not None
        begin = self._way[0]
        back = [np.append(each[: self._arm], self._last[self._arm]).astype(np.float32) for each in self._way[::-1]]
        self._way, self._backs_off = [], True
        self._begun, self._still = self._begun + 1, 0
        return [*back, *[begin] * RESTS]

    def goes_on(self) -> None:
        """Take what comes next for the policy's own actions."""
        self._backs_off = False

    def follow(self, action: Action) -> None:
        """Count for how long targets have been the same; a hand that presses stands beside its own."""
        last = self._last
        moves = last is None or bool(np.abs(action[: self._arm] - last[: self._arm]).max() > STILL)
        if not moves and last is not None and abs(float(action[self._arm] - last[self._arm])) <= STILL:
            self._still += 1
            return
        self._still, self._last = 0, action
        if moves and not self._backs_off:
            self._way.append(action)

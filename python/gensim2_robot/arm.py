"""An arm behind its limits: the only way to the wire."""

from __future__ import annotations

from collections import Counter, deque

import numpy as np
import numpy.typing as npt

from gensim2_robot.arm_limits import ArmLimits, Array
from gensim2_robot.devices import ArmDriver, ArmState
from gensim2_robot.limits import Sent, begin, check_force, halt, limit

_KEPT = 200
"""States that are kept, to know where the arm stood when a picture was taken."""


class Arm:
    """Commands go through :func:`~gensim2_robot.limits.limit`; there is no other way to the driver.

    Args:
        driver: the wire.
        limits: of every command.

    Attributes:
        clips: how often each limit kept a command from being what was asked for.
    """

    def __init__(self, driver: ArmDriver, limits: ArmLimits) -> None:
        self._driver, self.limits = driver, limits
        self._states: deque[ArmState] = deque(maxlen=_KEPT)
        self._sent: Sent | None = None
        self._gripper = 1.0
        self.clips: Counter[str] = Counter()

    def poll(self) -> list[ArmState]:
        """Take note of states that came."""
        found = list(self._driver.poll())
        self._states.extend(found)
        return found

    def state(self) -> ArmState | None:
        """The last known; None: none has come yet."""
        return self._states[-1] if self._states else None

    def at(self, time: float) -> ArmState:
        """Return the arm's state at a time, interpolated between two measurements in proportion.

        Raises:
            LookupError: no state has come yet.
        """
        if not self._states:
            raise LookupError("the arm has not said anything yet")
        after = next((each for each in self._states if each.time >= time), None)
        if after is None:
            return self._states[-1]
        before = next((each for each in reversed(self._states) if each.time < time), after)
        share = 0.0 if after is before else (time - before.time) / (after.time - before.time)
        q, v = (one + share * (two - one) for one, two in ((before.q, after.q), (before.v, after.v)))
        return ArmState(time, q, v, after.force, after.mode, after.reason)

    @property
    def sent(self) -> Sent | None:
        """The last command; None: the arm is not begun."""
        return self._sent

    @property
    def gripper(self) -> float:
        """The last command of the gripper."""
        return self._gripper

    def begin(self, q: npt.ArrayLike, gripper: float = 1.0) -> Sent:
        """Take the arm over where it stands.

        Raises:
            RefusedError: it stands where it may not be.
        """
        self._sent, self._gripper = begin(q, self.limits), gripper
        return self._sent

    def release(self) -> None:
        """Send nothing more until the arm is begun anew; it stands by its own means."""
        if self._sent is not None:
            self.stop()

    def command(self, q: npt.ArrayLike, gripper: float, t: float) -> Sent:
        """Ask for (m,) joints at the time t; returns what was sent.

        Raises:
            RefusedError: the target is not finite, or too great a force presses on the arm; nothing is sent.
        """
        assert self._sent is not None, "the arm is not begun"
        state = self.state()
        force, measured = (0.0, None) if state is None else (state.force, self.joints(state.q))
        return self._send(limit(self._sent, q, self.limits, force, measured), gripper, t)

    def hold(self, t: float) -> Sent:
        """The next command of the checked stop; at rest, the same place.

        Raises:
            RefusedError: too great a force presses on the arm; nothing is sent.
        """
        assert self._sent is not None, "the arm is not begun"
        state = self.state()
        if state is not None:
            check_force(state.force, self.limits)
        return self._send(halt(self._sent), self._gripper, t)

    def stop(self) -> None:
        """Let the arm stop by its own means, at once; it takes no command until it is begun anew."""
        self._driver.stand()
        self._sent = None

    def _send(self, sent: Sent, gripper: float, t: float) -> Sent:
        self._sent = sent
        self.clips.update(sent.clips)
        self._gripper = float(np.clip(gripper, -1.0, 1.0))
        self._driver.send(sent.q, self._gripper, t)
        return sent

    def joints(self, q: Array) -> Array:
        """(m,) of the arm of (n,) all active joints."""
        return q[list(self.limits.profile.arm_columns)]

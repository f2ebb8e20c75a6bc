"""An arm behind its limits: the only way to the wire."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

import gensim2_kpam as kpam
from gensim2_robot.arm_limits import CYCLE, ArmLimits, Array
from gensim2_robot.devices import ArmDriver, ArmState
from gensim2_robot.limits import Sent, begin, check_force, halt, limit

_STATES = 200
"""States that are kept, to know where the arm stood when a picture was taken."""


class LimitedArm:
    """Commands go through :func:`~gensim2_robot.limits.limit`; there is no other way to the driver.

    Args:
        driver: the wire.
        limits: of every command.

    Attributes:
        clips: how often each limit kept a command from being what was asked for.
    """

    def __init__(self, driver: ArmDriver, limits: ArmLimits) -> None:
        self._driver, self.limits = driver, limits
        self._states: deque[ArmState] = deque(maxlen=_STATES)
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


_SAME = 1e-6
"""Rad (m) within which two targets are one, and a command is what the motion says."""

_PASSED = 2 * CYCLE
"""Seconds before its time from which on a target is left to what follows: a motion that is a little late need not turn
back for it."""

_KEPT = 1.0
"""Seconds of the past that are kept: the last command is asked about."""

_FITTED = 0.999
"""Share of the limits that motions use: what they ask for is to be sent as it is."""


class Streamer:
    """The motion that commands are read from.

    It goes through the targets that are still to come, each no earlier than its time, and then comes to rest a little
    behind the last: where no more targets come, it has stopped by itself. New targets are joined to it where it is.

    Args:
        limits: that the motion keeps; those of the tool and of the workspace are the wire's.

    Attributes:
        late: targets that came when their time was over, and were dropped.
    """

    def __init__(self, limits: ArmLimits) -> None:
        self._limits = limits
        # The way from one command to the next is as fast as the middle between them, and limited by where it leads to.
        braking = limits.braking
        self._braking = None if braking is None else braking.ahead(0.5 * CYCLE).scaled(_FITTED).rows()
        self._motion: kpam.Trajectory | None = None
        self._ahead: list[tuple[float, Array]] = []
        self._rows: Array = np.zeros((3, limits.size))
        self.late = 0

    def clear(self) -> None:
        """Forget everything; the arm stands."""
        self._motion, self._ahead = None, []

    def add(self, targets: Sequence[tuple[float, Array]], sent: Sent, now: float) -> bool:
        """Go through targets, (m,) each with its time (s), after those that there are; say whether they were joined.

        Args:
            sent: the last command; the motion starts from there where it is not what the motion says.
            now: seconds.
        """
        fresh = [(stamp, np.clip(q, self._limits.lower, self._limits.upper)) for stamp, q in targets if stamp > now]
        self.late += len(targets) - len(fresh)
        self._ahead = [each for each in self._ahead if each[0] > now + _PASSED] + fresh
        q, v, a = self._state(sent, now)
        times, rows = [now], [q]
        for stamp, target in self._ahead:
            if np.abs(target - rows[-1]).max() > _SAME and stamp > times[-1]:
                times.append(stamp)
                rows.append(target)
        if len(rows) == 1:
            return True
        stretch = np.diff(times)
        rows.append(rows[-1] + self._rest(rows[-1], (rows[-1] - rows[-2]) / max(stretch[-1], CYCLE)))
        slowest = [*stretch, CYCLE]
        if np.abs(rows[-1] - rows[-2]).max() <= _SAME:
            rows.pop()
            slowest.pop()
        try:
            found, _ = kpam.retime(
                rows,
                _FITTED * self._limits.velocity,
                _FITTED * self._limits.acceleration,
                _FITTED * self._limits.jerk,
                slowest=slowest,
                braking=self._braking,
                start_velocity=v,
                start_acceleration=a,
                start_time=now,
            )
            if self._motion is not None and q is not sent.q:
                found = self._motion.splice(found, now).since(now - _KEPT)
            self._motion = found
        except kpam.KpamError:
            return False  # what there is comes to rest by itself, and the next targets are joined from there
        return True

    def _rest(self, q: Array, speed: Array) -> Array:
        """(m,) way in which the arm comes to rest from (m,) joints and a speed, within the joints' range."""
        speed = np.clip(speed, -self._limits.velocity, self._limits.velocity)
        way: Array = 0.75 * speed * (np.abs(speed) / self._limits.acceleration).max()
        room = np.where(way > 0.0, self._limits.upper - q, q - self._limits.lower)
        return way * min(1.0, float((room / np.maximum(np.abs(way), _SAME)).min()))

    def _state(self, sent: Sent, now: float) -> tuple[Array, Array, Array]:
        """(m,) position, velocity and acceleration to go on from: the motion's where it is what is sent."""
        if self._motion is not None and self.follows(sent, now):
            return self._motion.sample(now)
        return sent.q, sent.v, sent.a

    def follows(self, sent: Sent, now: float) -> bool:
        """Whether the last command is what the motion says of its time."""
        return self._motion is not None and bool(np.abs(self._motion.sample(now)[0] - sent.q).max() <= _SAME)

    def brake(self, now: float) -> float:
        """Come to rest along the path as soon as the limits allow, in the seconds returned; the targets are dropped."""
        self._ahead = []
        if self._motion is None:
            return 0.0
        self._motion = self._motion.brake(now)
        return self._motion.duration

    def at(self, now: float, sent: Sent) -> Array:
        """(m,) to be sent for a time; where the arm is, if there is no motion."""
        if self._motion is None:
            return sent.q
        self._motion.sample_into(now, *self._rows)
        found: Array = self._rows[0].copy()
        return found

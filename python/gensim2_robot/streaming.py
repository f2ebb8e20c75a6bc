"""Targets with time stamps to commands at the rate of the wire, by the solver's splines."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import gensim2_kpam as kpam
from gensim2_robot.arm_limits import CYCLE, ArmLimits, Array
from gensim2_robot.limits import Sent

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

"""Send commands to an arm, but only within the limits of the arm."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

import gensim2_kpam as kpam
from gensim2.core.arrays import Array
from gensim2_robot.arm_limits import CYCLE, ArmLimits
from gensim2_robot.devices import ArmDriver, ArmState
from gensim2_robot.limits import Sent, begin, check_force, halt, limit

_STATES = 200
"""Number of past arm states that are stored. The arm's position at the time of an image is interpolated between
them.
"""
FORCE_MEMORY = 1.0
"""Time constant (s) with which the effect of a past contact force fades. Without this memory, an arm that gave way
would press again.
"""


class LimitedArm:
    """Arm whose commands are all checked by :func:`~gensim2_robot.limits.limit` before the driver gets them.

    Args:
        driver: driver of the arm.
        limits: limits of every command.

    Attributes:
        clips: number of commands that each limit has changed, by the name of the limit.
    """

    def __init__(self, driver: ArmDriver, limits: ArmLimits) -> None:
        self._driver, self.limits = driver, limits
        self._states: deque[ArmState] = deque(maxlen=_STATES)
        self._sent: Sent | None = None
        self._gripper = 1.0
        self._recent = 0.0
        self.clips: Counter[str] = Counter()

    def poll(self) -> list[ArmState]:
        """Return the arm states received since the last call, and store them for :meth:`at`."""
        found = list(self._driver.poll())
        for each in found:
            passed = each.time - self._states[-1].time if self._states else 0.0
            self._recent = max(each.force, self._recent * float(np.exp(-max(passed, 0.0) / FORCE_MEMORY)))
            self._states.append(each)
        return found

    def state(self) -> ArmState | None:
        """Return the last received state; None before the first state arrives."""
        return self._states[-1] if self._states else None

    def at(self, time: float) -> ArmState:
        """Return the arm's state at a time, linearly interpolated between two measurements.

        Raises:
            LookupError: no state has been received yet.
        """
        if not self._states:
            raise LookupError("the arm has not reported its state yet")
        after = next((each for each in self._states if each.time >= time), None)
        if after is None:
            return self._states[-1]
        before = next((each for each in reversed(self._states) if each.time < time), after)
        share = 0.0 if after is before else (time - before.time) / (after.time - before.time)
        q, v = (one + share * (two - one) for one, two in ((before.q, after.q), (before.v, after.v)))
        return ArmState(time, q, v, after.force, after.mode, after.reason)

    @property
    def sent(self) -> Sent | None:
        return self._sent

    @property
    def gripper(self) -> float:
        return self._gripper

    def begin(self, q: npt.ArrayLike, gripper: float = 1.0) -> Sent:
        """Start to control the arm at its current position.

        Raises:
            RefusedError: the arm is outside its limits.
        """
        self._sent, self._gripper = begin(q, self.limits), gripper
        return self._sent

    def release(self) -> None:
        """Stop sending commands; the arm's own controller keeps the position until :meth:`begin` is called."""
        if self._sent is not None:
            self.stop()

    def command(self, q: npt.ArrayLike, gripper: float, t: float) -> Sent:
        """Send the next command towards the requested joints and return it.

        The command is changed so that it respects all limits.

        Args:
            q: (m,) requested joints, rad or m.
            gripper: gripper command, -1 (closed) to 1 (open).
            t: time at which the command is due, s.

        Raises:
            RefusedError: the target is not finite, or the contact force is too large; nothing is sent.
        """
        assert self._sent is not None, "the arm is not begun"
        state = self.state()
        if state is None:
            return self._send(limit(self._sent, q, self.limits), gripper, t)
        measured, v = self.joints(state.q), self.joints(state.v)
        return self._send(limit(self._sent, q, self.limits, state.force, measured, v, self._recent), gripper, t)

    def hold(self, t: float) -> Sent:
        """Send the next command of the braking motion, which was checked with the last normal command.

        An arm at rest gets its last position.

        Args:
            t: time at which the command is due, s.

        Raises:
            RefusedError: the contact force is too large; nothing is sent.
        """
        assert self._sent is not None, "the arm is not begun"
        state = self.state()
        if state is not None:
            check_force(state.force, self.limits)
        return self._send(halt(self._sent), self._gripper, t)

    def stop(self) -> None:
        """Stop the arm through its own controller. Commands are refused until :meth:`begin` is called."""
        self._driver.stand()
        self._sent = None

    def _send(self, sent: Sent, gripper: float, t: float) -> Sent:
        self._sent = sent
        self.clips.update(sent.clips)
        self._gripper = float(np.clip(gripper, -1.0, 1.0))
        self._driver.send(sent.q, self._gripper, t)
        return sent

    def joints(self, q: Array) -> Array:
        """Return the arm's joints (m,) from all active joints ``q`` (n,)."""
        return q[list(self.limits.profile.arm_columns)]


_SAME = 1e-6
"""Targets, or a command and the motion, that differ by at most this amount (rad or m) count as equal."""

_PASSED = 2 * CYCLE
"""A target that is closer than this (s) is dropped, so that a motion that is slightly late does not turn back."""

_KEPT = 1.0
"""Time (s) for which the past motion is stored for comparison with the last command."""

_FITTED = 0.999
"""Fraction of the limits that motions use, so that the limits rarely change a sampled command."""


class Streamer:
    """Plans a smooth motion through the targets; commands are samples of this motion.

    The motion reaches targets at their times or later, and rests shortly after the last target. New targets extend it.

    Args:
        limits: joint limits of the motion. The limits of the tool and of the workspace are checked for each command.

    Attributes:
        late: number of targets that were dropped because they arrived too late.
    """

    def __init__(self, limits: ArmLimits) -> None:
        self._limits = limits
        # The velocity of a command is the motion's velocity in the middle of the cycle, but its limit is the limit at
        # the position at the end. Therefore the motion must respect the limits half a cycle ahead.
        braking = limits.braking
        self._braking = None if braking is None else braking.ahead(0.5 * CYCLE).scaled(_FITTED).rows()
        self._motion: kpam.Trajectory | None = None
        self._ahead: list[tuple[float, Array]] = []
        self._newest: list[tuple[float, Array]] = []
        self._rows: Array = np.zeros((3, limits.size))
        self.late = 0

    def clear(self) -> None:
        self._motion, self._ahead, self._newest = None, [], []

    def add(self, targets: Sequence[tuple[float, Array]], sent: Sent, now: float) -> bool:
        """Append targets to the motion, and return whether a motion through all targets was found.

        Args:
            targets: time (s) and joints (m,) of each target.
            sent: the last command. If it deviates from the motion, the new motion starts at this command.
            now: current time, s.
        """
        fresh = [(stamp, np.clip(q, self._limits.lower, self._limits.upper)) for stamp, q in targets if stamp > now]
        self.late += len(targets) - len(fresh)
        self._ahead = [each for each in self._ahead if each[0] > now + _PASSED] + fresh
        q, v, a = self._state(sent, now)
        for given in fresh:
            if not self._newest or given[0] > self._newest[-1][0]:
                self._newest = [*self._newest[-1:], given]
        times, rows = [now], [q]
        for stamp, target in self._ahead:
            if np.abs(target - rows[-1]).max() > _SAME and stamp > times[-1]:
                times.append(stamp)
                rows.append(target)
        if len(rows) == 1:
            return True
        stretch = np.diff(times)
        # The velocity at the last target is the velocity between the last two targets, even if they have passed. The
        # velocity is 0 if they are equal or if there is only one target.
        before, last = self._newest[0], self._newest[-1]
        rows.append(rows[-1] + self._rest(rows[-1], (last[1] - before[1]) / max(last[0] - before[0], CYCLE)))
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
            return False  # The arm continues its present motion, which ends at rest.
        return True

    def _rest(self, q: Array, speed: Array) -> Array:
        """Return the displacement (m,) while braking from ``speed``.

        The displacement is cut at the ends of the joint range.
        """
        speed = np.clip(speed, -self._limits.velocity, self._limits.velocity)
        way: Array = 0.75 * speed * (np.abs(speed) / self._limits.acceleration).max()
        room = np.where(way > 0.0, self._limits.upper - q, q - self._limits.lower)
        return way * min(1.0, float((room / np.maximum(np.abs(way), _SAME)).min()))

    def _state(self, sent: Sent, now: float) -> tuple[Array, Array, Array]:
        """Return the state (m,) from which a new motion starts: of the motion if the last command is on it."""
        if self._motion is not None and self.follows(sent, now):
            return self._motion.sample(now)
        return sent.q, sent.v, sent.a

    def follows(self, sent: Sent, now: float) -> bool:
        """Return whether the last command is a sample of the planned motion."""
        return self._motion is not None and bool(np.abs(self._motion.sample(now)[0] - sent.q).max() <= _SAME)

    def brake(self, now: float) -> float:
        """Replace the targets and the motion by the fastest stop along the path. Return the duration of the stop, s."""
        self._ahead, self._newest = [], []
        if self._motion is None:
            return 0.0
        self._motion = self._motion.brake(now)
        return self._motion.duration

    def at(self, now: float, sent: Sent) -> Array:
        """Return the joints (m,) to send at a time; without a motion, the joints of the last command."""
        if self._motion is None:
            return sent.q
        self._motion.sample_into(now, *self._rows)
        found: Array = self._rows[0].copy()
        return found

"""Stream joint positions to an arm from a thread, so that no call of the control loop waits for the arm."""

from __future__ import annotations

import queue
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array
from gensim2.core.errors import GenSim2Error
from gensim2.robots import OPEN, RobotProfile
from gensim2_robot.arm_limits import CYCLE
from gensim2_robot.clocks import LOOP_PRIORITY, schedule_first
from gensim2_robot.devices import ArmMode, ArmState

KEPT = 1000
"""Maximum number of arm states that wait to be polled."""
SILENT = 0.15
"""Time (s) without a target after which the arm stops. Targets come every 10 ms, and may be up to 0.1 s late."""
LEAST, MOST = 1.0, 3.0
"""Number of cycles behind the newest target. Below the first number the arm slows down; above the second it is faster
by ``FASTER``.
"""
FASTER = 1.1
"""Playback speed (1 is real time) when the arm is too far behind, because late targets have arrived in a burst."""
HALTING = 2.0
"""Time limit for an arm's library to stop or disconnect the arm, s."""
TOO_MANY = 30
"""Maximum number of waiting targets, more than the control loop ever sends in a burst."""


class DriverError(GenSim2Error):
    """The connection to an arm fails, or the arm refuses commands."""


class StreamedArm(ABC):
    """Base class of arms that accept a stream of joint positions at their own rate.

    The loop sends 100 targets per second, one in each cycle, and a thread interpolates between them. The arm follows
    with a delay of one to three cycles, so targets that are slightly late or come in bursts cause no stop and no jerk.
    Without further targets, the arm slows down to the last one and is soon stopped. Another thread sends changed
    gripper commands, because the library may block.

    Args:
        rate: number of positions that the arm accepts per second.
    """

    def __init__(self, profile: RobotProfile, rate: float) -> None:
        self.profile, self._period = profile, 1.0 / rate
        self._states: deque[ArmState] = deque(maxlen=KEPT)
        self._lock, self._wire = threading.Lock(), threading.Lock()
        self._goals: deque[Array] = deque()
        self._passed: Array | None = None
        self._share = self._told = self._played = 0.0
        self._stood: Array | None = None
        self._gripper = OPEN
        self._told_grip: float | None = None  # None: no gripper command was sent yet
        self._grips: queue.SimpleQueue[float | None] = queue.SimpleQueue()
        self._standing, self._over = True, False
        self._trouble: str | None = None
        self._last: ArmState | None = None
        self._threads: list[threading.Thread] = []

    def start(self) -> None:
        for target in (self._run, self._run_gripper):
            self._threads.append(threading.Thread(target=target, name=type(self).__name__, daemon=True))
            self._threads[-1].start()

    def poll(self) -> Sequence[ArmState]:
        found = []
        while self._states:
            found.append(self._states.popleft())
        return found

    def send(self, q: Array, gripper: float, t: float) -> None:
        """Accept targets for the time ``t`` (s): joints (m,), and a gripper command from -1 to 1."""
        if self._trouble is not None:
            return  # The arm's states report the failure.
        with self._lock:
            self._told, target = time.monotonic(), np.array(q, dtype=np.float64)
            if self._passed is None:
                self._passed = target if self._stood is None else self._stood
                self._share, self._played = 0.0, self._told + CYCLE  # Playback starts one cycle after the first target.
            self._goals.append(target)
            self._standing = False
        if gripper != self._told_grip:
            self._gripper = self._told_grip = float(gripper)
            self._grips.put(self._gripper)

    def stand(self) -> None:
        """Stop the arm at once through its own controller."""
        with self._lock:
            self._standing, self._passed = True, None
            self._goals.clear()
        self._within(HALTING, self._halt_wire)

    def _halt_wire(self) -> None:
        with self._wire:  # Wait until the thread has written the current target to the arm.
            self._halt()

    def _within(self, seconds: float, what: Callable[[], None]) -> None:
        """Call the arm's library in a thread for at most ``seconds``.

        A call that takes longer is reported as a failure.
        """
        thread = threading.Thread(target=self._attempt, args=(what,), daemon=True)
        thread.start()
        thread.join(timeout=seconds)
        if thread.is_alive():
            self._trouble = f"the arm's library did not answer within {seconds:g} s"

    def close(self) -> None:
        """Stop and disconnect the arm."""
        self.stand()
        self._over = True
        self._grips.put(None)
        for thread in self._threads:
            thread.join(timeout=2.0)
        self._within(HALTING, self._disconnect)

    @abstractmethod
    def _read(self) -> tuple[Array, Array, float, ArmMode]:
        """Return joints and velocities (m,) of the arm, the contact force (N), and the mode of the arm."""

    @abstractmethod
    def _write(self, q: Array, v: Array) -> None:
        """Send joint positions and velocities (m,) to the arm. Raise DriverError if it refuses."""

    @abstractmethod
    def _halt(self) -> None:
        """Stop the arm through its own controller."""

    @abstractmethod
    def _grip(self, command: float) -> None:
        """Send a command to the gripper, -1 (closed) to 1 (open). The method may block until the gripper has moved."""

    @abstractmethod
    def _disconnect(self) -> None:
        """Disconnect the arm."""

    def _run(self) -> None:
        schedule_first(LOOP_PRIORITY)
        due = time.monotonic()
        while not self._over:
            self._cycle()
            due = max(due + self._period, time.monotonic())
            time.sleep(max(0.0, due - time.monotonic()))

    def _cycle(self) -> None:
        found = self._attempt(self._read)
        now = time.monotonic()
        if found is not None:
            arm, speed, force, mode = found
            self._stood = arm
            q, v = np.empty(len(self.profile.reset_qpos)), np.zeros(len(self.profile.reset_qpos))
            columns = list(self.profile.arm_columns)
            q[columns], v[columns] = arm, speed
            q[list(self.profile.gripper_columns)] = self.profile.gripper.at_command(self._gripper)
            refuses = self._trouble is not None
            self._last = ArmState(now, q, v, force, "refusing" if refuses else mode, self._trouble or "")
            self._states.append(self._last)
        elif self._last is not None:  # The connection is lost: return the last state with the reason of the failure.
            self._states.append(replace(self._last, mode="refusing", reason=self._trouble or ""))
        with self._lock:
            if self._standing or self._passed is None:
                return
            trouble = None
            if now - self._told > SILENT:
                trouble = f"no target for {1e3 * SILENT:.0f} ms"
            elif len(self._goals) > TOO_MANY:
                trouble = f"more than {1 / CYCLE:.0f} targets a second"
            goal, speed = self._play(now)
        if trouble is None:
            with self._wire:
                if not self._standing:
                    self._attempt(lambda: self._write(goal, speed))
        else:
            self.stand()
            self._trouble = trouble

    def _play(self, now: float) -> tuple[Array, Array]:
        """Advance the stream to the time ``now``, and return position (m,), rad, and velocity (m,), rad/s."""
        assert self._passed is not None
        if now < self._played:
            return self._passed, np.zeros_like(self._passed)
        self._share += _gone(len(self._goals) - self._share, (now - self._played) / CYCLE)
        self._played = now
        while self._goals and self._share >= 1.0:
            self._passed = self._goals.popleft()
            self._share -= 1.0
        if not self._goals:
            self._share = 0.0
            return self._passed, np.zeros_like(self._passed)
        way = self._goals[0] - self._passed
        return self._passed + self._share * way, _pace(len(self._goals) - self._share) * way / CYCLE

    def _run_gripper(self) -> None:
        while True:
            command = self._grips.get()
            while not self._grips.empty():  # only the newest gripper command matters
                command = self._grips.get()
            if command is None or self._over:
                return
            wanted = command
            self._attempt(lambda wanted=wanted: self._grip(wanted))

    def _attempt(self, what: Any) -> Any:
        """Return the result of a call of the library.

        If the call fails, return None. The reason is then in the next state of the arm.
        """
        try:
            return what()
        except Exception as error:  # noqa: BLE001 - libraries raise any exception; the watchdog reacts to the state
            self._trouble = f"{type(error).__name__}: {error}"
            return None

    @property
    def trouble(self) -> str | None:
        """The last error of the arm's library; None if there was none."""
        return self._trouble


def _pace(left: float) -> float:
    """Return the playback speed of the stream; 1 is real time. ``left`` is the number of targets that remain."""
    return FASTER if left > MOST else min(1.0, left / LEAST)


def _gone(left: float, cycles: float) -> float:
    """Return the number of targets, a cycle apart, by which the stream advances in ``cycles``; less than ``left``."""
    pace = max(1.0, _pace(left))
    straight = min(pace * cycles, max(0.0, left - LEAST))
    rest = cycles - straight / pace
    return straight + min(left, LEAST) * (1.0 - float(np.exp(-rest / LEAST)))


def finite(values: Any, size: int, what: str) -> npt.NDArray[np.float64]:
    """Check numbers that an arm's library reported, and return them as an array (size,).

    Args:
        values: reported numbers; numbers beyond the first ``size`` are ignored.
        size: number of expected numbers.
        what: what the numbers describe, for the message of an error.

    Raises:
        DriverError: the numbers are not finite, or there are too few.
    """
    found = np.asarray(values, dtype=np.float64).reshape(-1)[:size]
    if found.shape != (size,) or not np.isfinite(found).all():
        raise DriverError(f"the arm reported a non-finite {what}")
    return found

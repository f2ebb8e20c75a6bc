"""Decide whether an arm may move.

The watchdog is a state machine with the states idle, armed, running, holding and stopped.

The watchdog is only a software stop; it is not safety-rated (see docs/guides/robot.md).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import GenSim2Error
from gensim2_robot.devices import ArmState, CameraFrame
from gensim2_robot.limits import Sent

TOLD_APART = 48
"""Minimum number of measurements in an image row for which noise never produces the same row twice."""


class State(StrEnum):
    """State of a watchdog."""

    IDLE = "idle"
    ARMED = "armed"
    RUNNING = "running"
    HOLDING = "holding"
    STOPPED = "stopped"


class StateError(GenSim2Error):
    """The current state of the watchdog does not allow a transition."""


@dataclass(frozen=True)
class WatchRules:
    """Tolerances of the watchdog, in s unless stated otherwise.

    Attributes:
        frame_age: maximum age of an image that an observation uses.
        apart: maximum time between the captures of the newest images of two cameras.
        no_action: time limit for an answer of the controller while the arm moves.
        thinking: time limit for an answer of the controller while the arm stands still.
        late_answers: the arm is held after this number of consecutive answers in which all actions are too late.
        state_age: maximum age of the newest state received from the arm.
        behind: maximum distance (rad or m) of the joints from the nearest recent command while the force is below
            ``pressed``.
        pressed: contact force (N) that may mean an obstacle. A blocked arm is then held only at the force limit.
        window: maximum age of the recent commands with which the arm's joints are compared.
        overrun: maximum tolerated delay of the start of a period.
        overruns: the arm is stopped after this number of consecutive delays that are larger than ``overrun``.
    """

    frame_age: float = 0.150
    apart: float = 0.050
    no_action: float = 0.200
    thinking: float = 20.0
    late_answers: int = 3
    state_age: float = 0.100
    behind: float = 0.08
    pressed: float = 10.0
    window: float = 0.300
    overrun: float = 0.020
    overruns: int = 3


@dataclass(frozen=True)
class StateChange:
    """A change of the watchdog's state.

    Attributes:
        time: time of the change, s.
        reason: reason for the change, as text.
        at_once: whether the arm's own controller must stop it, because commands would be late or refused.
    """

    time: float
    state: State
    reason: str
    at_once: bool = False


@dataclass
class Watch:
    """State machine of the watchdog. Events change its state; it sends no commands itself.

    After a hold, a person can resume the run. After a stop, a new run must be started.

    Attributes:
        rules: tolerances of the watchdog.
        serials: expected serial number by camera name.
    """

    rules: WatchRules = field(default_factory=WatchRules)
    serials: Mapping[str, str] = field(default_factory=dict)
    state: State = State.IDLE
    reason: str = ""
    changes: list[StateChange] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        self._frames: dict[str, CameraFrame] = {}
        self._forget_motion()

    def _forget_motion(self) -> None:
        self._commands: list[tuple[float, Sent]] = []
        self._asked: float | None = None
        self._moved_since = False
        self._late_answers = 0
        self._overruns = 0

    def arm(self, now: float) -> None:
        """Enter the state ``armed``: all devices are ready, and the arm does not move yet."""
        self._require(State.IDLE)
        self._change(now, State.ARMED, "ready")

    def run(self, now: float) -> None:
        """Enter the state ``running``, in which the controller may move the arm."""
        self._require(State.ARMED)
        self._change(now, State.RUNNING, "episode started")

    def rest(self, now: float, reason: str = "episode over") -> None:
        self._require(State.ARMED, State.RUNNING)
        self._change(now, State.IDLE, reason)

    def hold(self, now: float, reason: str) -> None:
        """Enter the state ``holding``, in which the arm comes to rest and stays there. A stopped arm stays stopped."""
        if self.state in (State.ARMED, State.RUNNING):
            self._change(now, State.HOLDING, reason)

    def stop(self, now: float, reason: str, *, at_once: bool = False) -> None:
        """Enter the state ``stopped`` from any state.

        Args:
            now: current time, s.
            reason: reason for the stop, as text.
            at_once: whether the arm's own controller must stop the arm. If False, the control loop brakes the arm.
        """
        if self.state is not State.STOPPED:
            self._change(now, State.STOPPED, reason, at_once)

    @property
    def stops_at_once(self) -> bool:
        """Whether the arm must be stopped through its own controller, not by commands of the control loop."""
        return self.state is State.STOPPED and self.changes[-1].at_once

    def resume(self, now: float, person: str) -> None:
        """Continue after a hold.

        Args:
            person: name of the person who resumes.

        Raises:
            StateError: the arm is not held, or no person is named.
        """
        self._require(State.HOLDING)
        if not person:
            raise StateError("only a person may resume the arm: give the person's name")
        self._forget_motion()
        self._change(now, State.RUNNING, f"resumed by {person}")

    def _require(self, *states: State) -> None:
        if self.state not in states:
            raise StateError(f"the state is {self.state}, but must be {' or '.join(states)}")

    def _change(self, now: float, state: State, reason: str, at_once: bool = False) -> None:
        self.state, self.reason = state, reason
        self.changes.append(StateChange(now, state, reason, at_once))

    def saw_frame(self, frame: CameraFrame, now: float) -> None:
        """Check a received image, and hold the arm if the image is faulty.

        Cameras have noise, so their images never repeat. An equal image means a frozen camera, and equal rows mean a
        torn image.
        """
        expected = self.serials.get(frame.camera)
        if expected is not None and frame.serial != expected:
            self.hold(now, f"camera {frame.camera}: the picture is of the device {frame.serial!r}, not {expected!r}")
        before = self._frames.get(frame.camera)
        if before is not None:
            if frame.captured < before.captured or frame.captured > now + self.rules.apart:
                self.hold(now, f"camera {frame.camera}: its clock jumped by {frame.captured - before.captured:.3f} s")
            elif frame.depth.shape != before.depth.shape:
                self.hold(now, f"camera {frame.camera}: the picture has another size")
            else:
                same = np.flatnonzero((frame.depth == before.depth).all(axis=1))
                if len(same) == len(frame.depth) and frame.depth.any():
                    self.hold(now, f"camera {frame.camera}: the picture is frozen")
                elif (rows := _told_apart(frame.depth[same])) > 0:
                    self.hold(now, f"camera {frame.camera}: the picture is torn, {rows} rows are of the one before")
        self._frames[frame.camera] = frame

    def saw_arm(self, state: ArmState, now: float) -> None:
        why = f": {state.reason}" if state.reason else ""
        if state.mode == "reflex":
            self.stop(now, f"the arm has stopped by itself: reflex{why}", at_once=True)
        elif state.mode == "refusing":
            self.stop(now, f"the arm refuses commands{why}", at_once=True)
        elif state.mode == "at-limit":
            self.hold(now, f"the arm is at a limit of its own{why}")
        if not (np.isfinite(state.q).all() and np.isfinite(state.v).all()):
            self.stop(now, "the arm reported a non-finite joint state")

    def sent(self, sent: Sent, time: float) -> None:
        self._commands = [each for each in self._commands if each[0] >= time - self.rules.window]
        self._commands.append((time, sent))

    def asked(self, now: float) -> None:
        if self._asked is None:
            self._asked, self._moved_since = now, False

    def answered(self) -> None:
        self._asked = None

    def came(self, late: bool, now: float) -> None:
        """Record that actions have arrived.

        Args:
            late: whether all actions of the controller's answer arrived too late to be executed. One such answer is
                normal when a motion starts. After several such answers in a row, the watchdog holds the arm.
            now: current time, s.
        """
        self._late_answers = self._late_answers + 1 if late else 0
        if self._late_answers >= self.rules.late_answers:
            self.hold(now, f"no action from the controller in time, {self._late_answers} answers in a row")

    def period(self, late: float, now: float) -> None:
        """Record that a period started with the delay ``late`` (s)."""
        self._overruns = self._overruns + 1 if late > self.rules.overrun else 0
        if self._overruns >= self.rules.overruns:
            self.stop(now, f"{self._overruns} periods in a row overran, the last by {1e3 * late:.0f} ms")

    def check_frames(self, cameras: Sequence[str], now: float) -> None:
        """Hold the arm if an image to be used is missing, too old, or much older than the image of another camera."""
        times = []
        for name in cameras:
            frame = self._frames.get(name)
            if frame is None:
                self.hold(now, f"camera {name}: no picture")
                return
            if now - frame.captured > self.rules.frame_age:
                self.hold(now, f"camera {name}: the last picture is {1e3 * (now - frame.captured):.0f} ms old")
                return
            times.append(frame.captured)
        if times and max(times) - min(times) > self.rules.apart:
            behind = cameras[times.index(min(times))]
            self.hold(
                now, f"camera {behind}: its picture is {1e3 * (max(times) - min(times)):.0f} ms behind the others"
            )

    def check_arm(self, state: ArmState | None, arm: np.ndarray | None, now: float) -> None:
        """Hold the arm if its state is missing or old, or if its joints are too far from all recent commands.

        Args:
            state: last state of the arm; None if the arm has not sent a state.
            arm: (m,) positions of the arm's joints in this state, rad or m.
            now: current time, s.
        """
        if self.state is not State.RUNNING:
            return
        if state is None or now - state.time > self.rules.state_age:
            age = "nothing" if state is None else f"{1e3 * (now - state.time):.0f} ms old"
            self.hold(now, f"the arm lags: its last word is {age}")
        elif arm is not None and self._commands:
            off = min(float(np.abs(sent.q - arm).max()) for _, sent in self._commands)
            if off > self.rules.behind and state.force < self.rules.pressed:
                self.hold(now, f"the arm lags: it is {off:.3f} rad from where it was sent")

    def check_answer(self, moves: bool, now: float) -> None:
        """Hold the arm if the controller has not answered in time."""
        if self._asked is None or self.state is not State.RUNNING:
            return
        # The shorter time limit applies if the arm has moved at any time since the request, even if the arm stands
        # still now. The arm may stand still only because it has executed all its actions and waits for the answer.
        self._moved_since |= moves
        waited = now - self._asked
        if waited > (self.rules.no_action if self._moved_since else self.rules.thinking):
            self.hold(now, f"no action from the controller for {1e3 * waited:.0f} ms")


def _told_apart(rows: npt.NDArray[np.uint16]) -> int:
    """Return the number of rows with at least ``TOLD_APART`` noisy measurements. Such rows never repeat by chance."""
    return int((np.count_nonzero(rows, axis=1) >= TOLD_APART).sum())

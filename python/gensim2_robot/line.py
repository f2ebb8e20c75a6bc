"""Run the control loop of an arm.

The loop receives states and images, requests actions, and sends commands within the limits.

A cycle lasts 10 ms, and a period has ten cycles. In each period, the loop requests the actions of the next period from
the controller, which is a policy or the planner. The loop makes periods one cycle shorter or longer until each request
follows soon after new images.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from gensim2.core.arrays import Array
from gensim2_robot.arm import LimitedArm, Streamer
from gensim2_robot.arm_limits import CYCLE
from gensim2_robot.clocks import Clock
from gensim2_robot.devices import CameraDriver, CameraFrame
from gensim2_robot.eyes import SensorSnapshot
from gensim2_robot.limits import RefusedError, Sent, admit
from gensim2_robot.log import Journal
from gensim2_robot.mind import Begin, ControllerAnswer, Question
from gensim2_robot.pipes import DeviceGoneError
from gensim2_robot.watch import State, Watch

PERIOD_CYCLES = 10
PERIOD = PERIOD_CYCLES * CYCLE
"""Time between two requests, s."""
LEAD = PERIOD
"""Minimum time from a request to its first action, s; the controller computes in this time."""
BRAKING = PERIOD - 3.0 * CYCLE
"""Maximum duration (s) of a stop along the path. On a bend, a stop off the path can be faster."""
CATCH_UP = 0.1
"""Maximum delay (s) that the loop catches up by running the missed cycles; cycles of a larger delay are skipped."""
FRESH_CYCLES = 3
"""Number of cycles after the arrival of images at which a request is still in time; later requests are shifted."""
STANDING = 0.02
"""Measured speed (rad/s or m/s) below which the arm counts as standing still."""


class Mind(Protocol):
    """Interface of the connection from the control loop to a controller. The methods of the connection never block."""

    def send(self, message: Begin | Question) -> None:
        """Send the start of an episode or a request for actions."""
        ...

    def poll(self) -> Sequence[ControllerAnswer]:
        """Return the answers received since the last call."""
        ...

    @property
    def is_ready(self) -> bool:
        """Whether the controller is ready for requests."""
        ...

    @property
    def is_alive(self) -> bool:
        """Whether the controller still runs."""
        ...

    def fail(self, fault: str) -> None:
        """Inject a fault, which persists."""
        ...

    def close(self) -> None:
        """Release the resources."""
        ...


@dataclass
class LoopFigures:
    """Measurements of the control loop; times are in s, or in ms if the name ends in ``_ms``.

    Attributes:
        periods: durations of the periods.
        late: delays of the starts of the periods.
        commands_late: delays of sent commands.
        picture_age_ms: for each request, the age of the newest image when the point cloud is computed.
        encoding_ms: times for computing a point cloud from images.
        acting_ms: computing times of the controller.
        refused: number of refused targets by reason.
        late_actions: number of actions that arrived too late to be executed.
        skipped: total time of the cycles that were skipped because the loop was too late.
    """

    periods: list[float] = field(default_factory=list)
    late: list[float] = field(default_factory=list)
    commands_late: list[float] = field(default_factory=list)
    picture_age_ms: list[float] = field(default_factory=list)
    encoding_ms: list[float] = field(default_factory=list)
    acting_ms: list[float] = field(default_factory=list)
    refused: Counter[str] = field(default_factory=Counter)
    late_actions: int = 0
    skipped: float = 0.0


def phase_shift(waited: int, latency: float = 0.0, max_age: float = np.inf) -> int:
    """Return the number of cycles (-1, 0 or 1) by which the current period should become longer.

    The length of periods changes until requests follow soon after new images, in the direction that needs fewer
    changes. Periods become shorter if images would be too old.

    Args:
        waited: number of cycles from the arrival of the newest complete set of images to a request.
        latency: delay of an image, s.
        max_age: maximum age of an image at a request, s.
    """
    # Do not shift if images are new enough. Shifting does not help either if images come less than once in a period.
    if waited <= FRESH_CYCLES or waited > PERIOD_CYCLES:
        return 0
    too_old = latency + PERIOD + 2 * CYCLE > max_age
    return -1 if too_old or waited <= PERIOD_CYCLES // 2 else 1


class Line:
    """The control loop that connects an arm, its cameras and a controller.

    Args:
        arm: arm with its limits.
        cameras: connection to the cameras.
        mind: connection to the controller.
        watch: watchdog; its state determines whether the arm may move.
        clock: clock of the loop.
        journal: log of the loop.
        pace: control steps per second.

    Attributes:
        pace: control steps per second.
        commands: list to which every command is appended; None if commands are not collected.
        done: whether the controller has ended the episode.
        refusal: reason why the controller has refused the episode; None if it has not refused the episode.
        in_phase: whether the requests are synchronized with the images (see :func:`phase_shift`).
        stopped_ms: time (ms) from the last hold or stop to the last command that moves. None before.
        standing_ms: time (ms) from the last hold or stop to the measured standstill. None before.
    """

    def __init__(
        self,
        arm: LimitedArm,
        cameras: CameraDriver,
        mind: Mind,
        watch: Watch,
        clock: Clock,
        journal: Journal,
        *,
        pace: float,
    ) -> None:
        self.arm, self._cameras, self._mind = arm, cameras, mind
        self.watch, self._clock, self._journal = watch, clock, journal
        self.pace = pace
        self._names = [camera.name for camera in cameras.cameras]
        self._streamer = Streamer(arm.limits)
        self.figures = LoopFigures()
        self.commands: list[Array] | None = None
        self.interrupted: str | None = None
        self._cycle = self._next_period = 0
        self._fresh: set[str] = set()
        self._fresh_at = 0
        self._written: dict[str, CameraFrame] = {}
        self._latency = 0.0
        self.in_phase = False
        self._number = 0
        self._sent_at = clock.now()
        self._braking = self._on_path = False
        self._period_began: float | None = None
        self._told = 0
        self.stopped_ms: float | None = None
        self.standing_ms: float | None = None
        self._seed, self._failed, self._first_number = 0, False, 0
        self.forget()

    def forget(self) -> None:
        """Discard the state of an episode, and release the arm until the next episode."""
        self.arm.release()
        # start a new cycle now, because the pause between episodes may have been long
        self._next = self._clock.now() + CYCLE
        self.watch.clear()
        self._streamer.clear()
        self.frames: dict[str, CameraFrame] = {}
        self._fresh.clear()  # discard incomplete sets of images, too
        self._steps = 0
        self._due = 0.0
        self._open: Question | None = None
        self._first: Array | None = None
        self._grips: list[tuple[float, float]] = []
        self._grip = 1.0
        self.done = False
        self.refusal: str | None = None
        self._paused_at: float | None = None

    def begin(self, seed: int) -> None:
        """Start an episode: take control of the arm at its current position, and start the controller's episode.

        Raises:
            RefusedError: the arm is outside its limits.
        """
        now = self._clock.now()
        state = self.arm.state()
        assert state is not None, "the arm has said where it stands"
        arm = self.arm.joints(state.q)
        self.arm.begin(arm)
        self._first = arm
        self.watch.arm(now)
        self._seed, self._failed, self._first_number = seed, False, self._number
        self._mind.send(Begin(seed))
        self.watch.run(now)
        self._due = now + LEAD

    def resume(self, person: str) -> None:
        """Continue after a hold, from the arm's current position; a failed controller is restarted."""
        now = self._clock.now()
        self.watch.resume(now, person)
        if self._failed:
            self._failed = False
            self._mind.send(Begin(self._seed))
        self._streamer.clear()
        self._due, self._open, self._grips = now + LEAD, None, []
        self._grip = self.arm.gripper  # The dropped actions contained gripper commands, which must not be sent.
        self.stopped_ms = self.standing_ms = None

    def pause(self) -> None:
        """Stop requesting actions until :meth:`go_on`, while the scene settles."""
        if self._paused_at is None:
            self._paused_at = self._clock.now()

    def go_on(self) -> None:
        """Request actions again after :meth:`pause`. The control steps of the pause count as executed."""
        if self._paused_at is not None:
            self._steps += round((self._clock.now() - self._paused_at) * self.pace)
            self._paused_at = None

    def cycle(self) -> None:
        self._clock.wait(self._next)
        due, now = self._next, self._clock.now()
        late = now - due
        if late > CATCH_UP:
            self.figures.skipped += late
            due = now
        self._next = due + CYCLE
        self._cycle += 1
        begins = self._cycle >= self._next_period
        if begins:
            self._measure_period(now, late)
        self._take_in(now)
        if begins:
            shift = phase_shift(self._cycle - self._fresh_at, self._latency, self.watch.rules.frame_age)
            self._next_period = self._cycle + PERIOD_CYCLES + shift
            self.in_phase = shift == 0
        self._check(now)
        if begins and self.watch.state is State.RUNNING:
            self.watch.check_frames(self._names, now)
        if begins and self.watch.state is State.RUNNING and self._paused_at is None and not self.done:
            self._ask(due, now)
        self._write_changes()
        self._drive(due, now)
        self._write_changes()
        if begins:
            self._write_frames()  # done last, because writing images takes time

    def _measure_period(self, now: float, late: float) -> None:
        if self._period_began is not None and self.watch.state is State.RUNNING:
            self.figures.periods.append(now - self._period_began)
            self.figures.late.append(late)
            self.watch.period(late, now)
            self._journal.clocks(now, late, {name: now - frame.captured for name, frame in self.frames.items()})
        self._period_began = now

    def _take_in(self, now: float) -> None:
        try:
            for state in self.arm.poll():
                self.watch.saw_arm(state, now)
                self._journal.state(state)
            for frame in self._cameras.poll():
                self.watch.saw_frame(frame, now)
                self.frames[frame.camera] = frame
                self._saw_fresh(frame.camera, now)
        except DeviceGoneError as error:
            self.watch.stop(now, str(error))
        for answer in self._mind.poll():
            self._hear(answer, now)
        if not self._mind.is_alive:
            self.watch.stop(now, "the controller's process has ended")

    def _write_frames(self) -> None:
        """Log the newest image of each camera; requests use only these images."""
        for name, frame in self.frames.items():
            if frame is not self._written.get(name):
                self._journal.frame(frame)
                self._written[name] = frame

    def _saw_fresh(self, camera: str, now: float) -> None:
        self._fresh.add(camera)
        if self._fresh.issuperset(self._names):
            self._fresh.clear()
            self._fresh_at = self._cycle
            self._latency = max(now - self.frames[name].captured for name in self._names)

    def _check(self, now: float) -> None:
        if self.interrupted is not None:
            self.watch.stop(now, f"a person or the system asked the program to stop (signal {self.interrupted})")
        if self._journal.trouble is not None:
            self.watch.hold(now, f"the log cannot be written: {self._journal.trouble}")
        state = self.arm.state()
        self.watch.check_arm(state, None if state is None else self.arm.joints(state.q), now)
        sent = self.arm.sent
        self.watch.check_answer(sent is not None and not sent.is_at_rest, now)

    def _ask(self, due: float, now: float) -> None:
        """Request actions up to the end of the next period, except actions that the controller has already sent."""
        if self._open is not None:
            return
        step = 1.0 / self.pace
        if self._due < due + LEAD - step:  # the controller was late: skip the missed steps
            self._due = due + LEAD
        count = int(np.ceil((due + LEAD + PERIOD - self._due) / step - 1e-9))
        state = self.arm.state()
        if count <= 0 or state is None:
            return
        frames = tuple(self.frames[name] for name in self._names)
        posed = {frame.camera: self.arm.at(frame.captured).q for frame in frames}
        sight = SensorSnapshot(self._steps, state.q, state.v, self.arm.gripper, frames, posed)
        self._open = Question(self._number, sight, count)
        self._number += 1
        self._journal.question(now, self._open)
        self._mind.send(self._open)
        self.watch.asked(now)

    def _hear(self, answer: ControllerAnswer, now: float) -> None:
        """Process the answer to the open request; ignore other answers, which belong to finished episodes."""
        is_open = self._open is not None and answer.number == self._open.number
        if is_open:
            self._open = None
            self.watch.answered()
            self._journal.answer(now, answer)
            self._note(answer)
        # an error in this episode holds the arm, even if another request is open
        if answer.error is not None and answer.number >= self._first_number:
            self._failed = True
            self.watch.hold(now, answer.error)
            return
        if not is_open:
            return
        self.done, self.refusal = answer.done, answer.refusal
        if self._paused_at is not None:  # The actions were requested before the pause and are outdated.
            return
        step, targets = 1.0 / self.pace, []
        for action in answer.actions:
            try:
                admitted = admit(action, self.arm.limits, self._first)
            except RefusedError as error:
                self.figures.refused[str(error)] += 1
                self.watch.hold(now, f"refused: {error}")
                return
            self._first = None
            self._due += step
            self._steps += 1
            targets.append((self._due, admitted[:-1]))
            self._grips.append((self._due - step, float(admitted[-1])))
        if self.watch.state is State.RUNNING and self.arm.sent is not None and targets:
            before = self._streamer.late
            self._streamer.add(targets, self.arm.sent, self._sent_at)
            late = self._streamer.late - before
            self.figures.late_actions += late
            self.watch.came(late == len(targets), now)

    def _note(self, answer: ControllerAnswer) -> None:
        if answer.cloud_ms is not None:
            self.figures.picture_age_ms.append(answer.cloud_ms)
        if answer.encoding_ms is not None:
            self.figures.encoding_ms.append(answer.encoding_ms)
        self.figures.acting_ms.append(answer.acting_ms)

    def _drive(self, due: float, now: float) -> None:
        """Send the command of this cycle.

        The command follows the controller's actions or brakes, depending on the state of the watchdog.
        """
        sent = self.arm.sent
        if sent is None:
            self._note_standing(now)
            return
        try:
            if self.watch.state is State.RUNNING:
                while self._grips and self._grips[0][0] <= due:
                    self._grip = self._grips.pop(0)[1]
                sent = self.arm.command(self._streamer.at(due, sent), self._grip, due)
            elif self.watch.state is State.HOLDING:
                sent = self._held(sent, due)
            elif self.watch.state is State.STOPPED:
                if self.watch.stops_at_once:
                    self._stop(now)
                    return
                sent = self.arm.hold(due)
                if sent.is_at_rest:
                    self._stop(now)
            else:
                sent = self.arm.hold(due)
        except RefusedError as error:  # the contact force is too large: stop at once
            self.watch.stop(now, str(error), at_once=True)
            self._write_changes()
            self._stop(now)
            return
        self._sent_at = due
        self.figures.commands_late.append(self._clock.now() - due)
        self.watch.sent(sent, due)
        self._journal.sent(due, sent, self.arm.gripper)
        if self.commands is not None:
            self.commands.append(sent.q)
        if self.watch.state is State.HOLDING and sent.is_at_rest:
            self._note_rest(now)
        self._note_standing(now)

    def _held(self, sent: Sent, due: float) -> Sent:
        """Return the next braking command: along the path, or the checked stop if off it or too slow."""
        if not self._braking:
            self._braking = True
            self._on_path = (
                self._streamer.follows(sent, self._sent_at) and self._streamer.brake(self._sent_at) <= BRAKING
            )
        if self._on_path and not sent.is_at_rest:
            return self.arm.command(self._streamer.at(due, sent), self._grip, due)
        return self.arm.hold(due)

    def _stop(self, now: float) -> None:
        self.arm.stop()
        self._note_rest(now)
        self._note_standing(now)

    def _note_rest(self, now: float) -> None:
        if self.stopped_ms is None:
            self.stopped_ms = 1e3 * (now - self.watch.changes[-1].time)

    def _note_standing(self, now: float) -> None:
        state = self.arm.state()
        if self.stopped_ms is None or self.standing_ms is not None or state is None:
            return
        if state.time >= self.watch.changes[-1].time and np.abs(self.arm.joints(state.v)).max() < STANDING:
            self.standing_ms = 1e3 * (now - self.watch.changes[-1].time)

    def _write_changes(self) -> None:
        for change in self.watch.changes[self._told :]:
            self._journal.change(change.time, change.state, change.reason)
            self._braking = self._on_path = False
            self.stopped_ms = self.standing_ms = None
        self._told = len(self.watch.changes)

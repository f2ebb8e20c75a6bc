"""Run episodes on one control loop until a time limit or an event, and collect the results."""

from __future__ import annotations

import contextlib
import signal
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from gensim2.core.errors import GenSim2Error
from gensim2.core.progress import Progress
from gensim2.rollout.inputs import TaskInput
from gensim2.rollout.motion import GOAL_SECONDS, MAX_SETTLE_SECONDS, may_judge
from gensim2.rollout.run import controller_seed
from gensim2_robot.arm_limits import CYCLE
from gensim2_robot.audit import limits_passed
from gensim2_robot.clocks import Clock, SimulatedClock
from gensim2_robot.devices import ArmDriver, CameraDriver, Keys
from gensim2_robot.faults import Fault, FullDisk
from gensim2_robot.limits import RefusedError
from gensim2_robot.line import Line, LoopFigures, Mind
from gensim2_robot.log_messages import About
from gensim2_robot.watch import State, Watch

PATIENCE = 120.0
"""Time limit for devices and controller to become ready, s."""
MEETING = 2.0
"""Time limit (s) for aligning requests with the arrival of images; after it the episode starts without alignment."""
COMING_TO_REST = 3.0
"""Time limit for a held or stopped arm to come to rest, s."""
RESUME = "r"


def _said(arm: object) -> str:
    """Return the last error of the arm's driver as a suffix for a message, or an empty string without an error."""
    trouble = getattr(arm, "trouble", None)
    return f": {trouble}" if trouble else ""


class SceneStage(Protocol):
    """Interface for the scenes of episodes, which arranges the next scene and reports the goal if it can."""

    @property
    def is_ready(self) -> bool:
        """Whether the scene of the last reset is ready."""
        ...

    @property
    def goal(self) -> bool | None:
        """Whether the goal is reached; None if only a person can tell."""
        ...

    @property
    def at_rest(self) -> bool | None:
        """Whether the scene is at rest; None if only a person can tell."""
        ...

    def reset(self, seed: int, options: Mapping[str, Any] | None = None) -> None:
        """Start to lay out a new scene; ``options`` replace random values."""
        ...


@dataclass
class Devices:
    """All devices of a control loop.

    Attributes:
        arm, cameras, mind, clock: arm, cameras, controller and clock of the loop.
        stage: arranges the scene of each episode.
        failing: function that injects a fault, by kind, which is the first word of a fault, such as ``camera``. Empty
            for real devices.
    """

    arm: ArmDriver
    cameras: CameraDriver
    mind: Mind
    clock: Clock
    stage: SceneStage
    failing: Mapping[str, Callable[[str], None]] = field(default_factory=dict)

    def close(self) -> None:
        """Close all devices, even if closing one of them fails."""
        with contextlib.ExitStack() as last_first:
            for each in (self.arm, self.cameras, self.mind):
                last_first.callback(each.close)


@dataclass(frozen=True)
class Layout:
    """A scene to lay out.

    Attributes:
        seed: seed of the random values in the scene.
        options: reset options, which replace random values.
    """

    seed: int
    options: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class Ended:
    """Result of an episode.

    Attributes:
        goal: whether the goal was reached at the end; None if only a person can tell.
        over: whether the controller ended the episode. False if the goal or the time limit ended it.
        seconds: duration, s.
        at_rest: whether the scene was at rest at the end; None if only a person can tell.
        lost: whether the goal ended the episode but did not hold after the scene had settled.
        refusal: reason why the controller has refused the episode; None if it has not refused the episode.
    """

    goal: bool | None
    over: bool
    seconds: float
    at_rest: bool | None = None
    lost: bool = False
    refusal: str | None = None

    @property
    def held(self) -> bool | None:
        """Whether the goal was reached with the scene at rest; None if only a person can tell."""
        return None if self.goal is None else self.goal and self.at_rest is not False

    @property
    def lacking(self) -> str:
        """Reason why the episode did not succeed: the goal was not reached, or the scene was not at rest."""
        if self.goal:
            return "the scene did not come to rest"
        if self.lost:
            return "the goal was reached, and lost again"
        if self.refusal is not None:
            return self.refusal
        return "it gave up" if self.over else "its time was over"


class Session:
    """Runs episodes on one control loop.

    Attributes:
        in_episode: whether an episode is running.
    """

    def __init__(
        self,
        line: Line,
        devices: Devices,
        given: TaskInput,
        faults: Sequence[Fault],
        disk: FullDisk | None,
        interrupted: list[int],
        keys: Keys | None,
        progress: Progress,
    ) -> None:
        self._line, self._devices, self._given = line, devices, given
        self._faults, self._disk, self._interrupted = list(faults), disk, interrupted
        self._keys, self._progress = keys, progress
        self._begun: float | None = None
        self._held_s = 0.0
        self._outcomes: list[bool | None] = []
        self._refusals: list[str] = []
        self._halts: list[dict[str, Any]] = []
        self._clips_passed = 0
        self._scheduling: str | None = None
        self.in_episode = False

    def run(
        self,
        seconds: float,
        layouts: Iterable[Layout],
        *,
        goal_ends: bool,
        ended: Callable[[Ended], None] = lambda end: None,
    ) -> None:
        """Run episodes until the time limit, until all layouts are done, or until a person or a fault ends the run.

        Args:
            seconds: time limit, s.
            layouts: scenes. The next scene is taken after the previous episode, so it can depend on the result of that
                episode.
            goal_ends: whether an episode ends when the goal has held for some time and still holds after settling.
            ended: callback that is called after each finished episode.
        """
        try:
            with self._devices.clock.punctual() as self._scheduling:
                self._go_through(seconds, layouts, goal_ends, ended)
        except GenSim2Error as error:
            self._line.watch.stop(self._devices.clock.now(), str(error), at_once=True)
            self._line.arm.release()  # The loop has ended and cannot stop the arm any more, so the arm is released now.

    def _go_through(
        self, seconds: float, layouts: Iterable[Layout], goal_ends: bool, ended: Callable[[Ended], None]
    ) -> None:
        watch = self._line.watch
        for each in layouts:
            if not self.prepare(each):
                return
            if self._begun is None:
                self._begun = self._devices.clock.now()
            try:
                self._line.begin(controller_seed(each.seed))
            except RefusedError as error:
                watch.stop(self._devices.clock.now(), f"not begun: {error}")
                return
            self.in_episode = True
            over = self._episode(self._begun + seconds, goal_ends, ended)
            self._count_passed()
            if watch.state in (State.HOLDING, State.STOPPED) or over:
                return

    def prepare(self, layout: Layout) -> bool:
        """Lay out a scene and wait for images of the scene; return whether the episode can start."""
        line, devices = self._line, self._devices
        line.forget()
        devices.stage.reset(layout.seed, layout.options)
        begun = time.monotonic()
        ready: float | None = None
        while True:
            self._cycle()
            if line.watch.state is State.STOPPED:
                return False
            if ready is None and devices.stage.is_ready and devices.mind.is_ready:
                ready = devices.clock.now()
            names = [camera.name for camera in devices.cameras.cameras]
            there = all(name in line.frames and line.frames[name].captured > (ready or np.inf) for name in names)
            state = line.arm.state()
            now = devices.clock.now()
            if ready is not None and there and state is not None and state.time > ready:
                fresh = min(line.frames[name].captured for name in names)
                settled = line.in_phase or now - ready > MEETING
                if settled and now - fresh < line.watch.rules.frame_age:
                    return True
            if time.monotonic() - begun > PATIENCE:
                lacking = self._lacking(names, now)
                line.watch.stop(now, f"devices were not ready within {PATIENCE:g} s: {lacking}")
                return False

    def _lacking(self, names: Sequence[str], now: float) -> str:
        """Describe what is missing for the start of an episode; empty if nothing is missing."""
        line, devices = self._line, self._devices
        if not devices.stage.is_ready:
            return "the scene is not laid out"
        if not devices.mind.is_ready:
            return "the controller is not made"
        if (state := line.arm.state()) is None:
            return f"the arm says nothing{_said(devices.arm)}"
        for name in names:
            if name not in line.frames:
                return f"camera {name}: no picture"
        ages = {name: now - line.frames[name].captured for name in names}
        slowest = max(ages, key=lambda name: ages[name])
        old, word = 1e3 * ages[slowest], 1e3 * (now - state.time)
        return f"pictures of camera {slowest} are {old:.0f} ms old, the arm's last word is {word:.0f}"

    def _episode(self, end: float, goal_ends: bool, ended: Callable[[Ended], None]) -> bool:
        """Run one episode, and return whether the run must end.

        The results of complete episodes are added to ``_outcomes``. An episode is complete when the controller is done,
        the goal is reached, or the episode's time limit is over. Episodes that the watchdog or the run's time limit
        interrupts are not added.
        """
        line, clock, stage = self._line, self._devices.clock, self._devices.stage
        begun, held_since, lost = clock.now(), None, False
        # As in a rollout, the limit of an episode includes the time to settle after the goal.
        most = self._episode_limit - (MAX_SETTLE_SECONDS if goal_ends else 0.0)
        while True:
            self._cycle()
            now = clock.now()
            if line.watch.state in (State.HOLDING, State.STOPPED):
                if (held := self._sat_out(now)) is None:
                    return True
                begun, held_since = begun + held, None
                continue
            held_since = (held_since or now) if goal_ends and stage.goal else None
            lasted = held_since is not None and now - held_since > GOAL_SECONDS
            if line.done or lasted or now - begun > most:
                over = line.done
                if (held := self._settle()) is None:
                    return True
                begun += held
                lost |= lasted and stage.goal is False
                if over or not lasted or stage.goal or clock.now() - begun > most:
                    break
                line.go_on()
                held_since = None
                continue
            if now - self._held_s > end:
                line.watch.rest(now, f"the time limit of the run ended episode {len(self._outcomes) + 1} early")
                self._stand()
                return True
        result = Ended(stage.goal, over, clock.now() - begun, stage.at_rest, lost, line.refusal)
        self.in_episode = False
        self._outcomes.append(result.held)
        said = {True: "held", False: "not held", None: "over"}[result.held]
        if result.refusal is not None:
            self._refusals.append(result.refusal)
            said += f", {result.refusal}"
        self._progress.message(f"episode {len(self._outcomes)}: {said}")
        line.watch.rest(clock.now())
        self._stand()  # the arm must be at rest, because the callback may wait for a person
        ended(result)
        return clock.now() - self._held_s > end

    @property
    def _episode_limit(self) -> float:
        """Time limit of an episode, s. At lower speed control steps take longer, so the limit is longer, too."""
        return self._given.spec.max_seconds * self._devices.arm.profile.control_hz / self._line.pace

    def _settle(self) -> float | None:
        """Keep the arm in place until the scene has settled; return the time (s) of holds, None if not resumed."""
        line, clock, stage = self._line, self._devices.clock, self._devices.stage
        line.pause()
        since, sat_out = clock.now(), 0.0
        while not may_judge(clock.now() - since - sat_out, stage.at_rest):
            self._cycle()
            if line.watch.state in (State.HOLDING, State.STOPPED):
                if (held := self._sat_out(clock.now())) is None:
                    return None
                sat_out += held
        return sat_out

    def _stand(self) -> None:
        """Bring the arm to rest with the stop that was checked against the limits, and release the arm."""
        line, until = self._line, self._devices.clock.now() + COMING_TO_REST
        while line.arm.sent is not None and not line.arm.sent.is_at_rest and self._devices.clock.now() < until:
            self._cycle()
        line.arm.release()

    def _cycle(self) -> None:
        line = self._line
        if self._interrupted and line.interrupted is None:
            line.interrupted = signal.Signals(self._interrupted[0]).name
        if self._begun is not None:
            since = self._devices.clock.now() - self._begun
            for fault in [each for each in self._faults if each.at <= since]:
                self._faults.remove(fault)
                self._fail(fault)
        key = None if self._keys is None else self._keys.pressed()
        if key is not None and key != RESUME:
            line.interrupted = f"the key {key!r}"
        self._pressed = key
        line.cycle()

    def _fail(self, fault: Fault) -> None:
        if fault.name == "disk-full":
            assert self._disk is not None, "a log is written"
            self._disk.full = True
        else:
            self._devices.failing[fault.kind](fault.name)

    def _come_to_rest(self) -> None:
        line, clock = self._line, self._devices.clock
        until = clock.now() + COMING_TO_REST
        state = line.watch.state
        while clock.now() < until and (line.stopped_ms is None or line.standing_ms is None):
            self._cycle()
            if line.watch.state is not state:
                state, until = line.watch.state, clock.now() + COMING_TO_REST
        change = line.watch.changes[-1]
        self._halts.append(
            {
                "state": str(change.state),
                "reason": change.reason,
                "detected_to_stopped_ms": line.stopped_ms,
                "detected_to_standing_ms": line.standing_ms,
            }
        )
        self._progress.message(f"{change.state}: {change.reason}")

    def _sat_out(self, since: float) -> float | None:
        """Wait for a person to resume the arm held at ``since`` (s); return the hold's duration (s) or None."""
        self._come_to_rest()
        if not self._resumed():
            return None
        held = self._devices.clock.now() - since
        self._held_s += held
        return held

    def _resumed(self) -> bool:
        """Return whether a person has resumed the held arm.

        Return False at once if there is no person at the keyboard.
        """
        line = self._line
        if line.watch.state is not State.HOLDING or self._keys is None or not self._keys.is_there:
            return False
        self._progress.message("r resumes, any other key stops")
        while line.watch.state is State.HOLDING:
            # The pause is needed with a simulated clock only; with the machine's clock, ``_cycle`` waits.
            time.sleep(CYCLE if isinstance(self._devices.clock, SimulatedClock) else 0.0)
            self._cycle()
            if self._pressed == RESUME:
                line.resume("the keyboard")
                return True
        return False

    def _count_passed(self) -> None:
        assert self._line.commands is not None
        self._clips_passed += limits_passed(self._line.commands, self._line.arm.limits)
        self._line.commands = []

    def report(self, about: About, log: Path | None) -> dict[str, Any]:
        self._count_passed()
        found = result(about, log, self._line.watch, self._line.figures, self._interrupted)
        halt = self._halts[-1] if self._halts else {}
        judged = [each for each in self._outcomes if each is not None]
        return {
            **found,
            "detected_to_stopped_ms": halt.get("detected_to_stopped_ms"),
            "detected_to_standing_ms": halt.get("detected_to_standing_ms"),
            "halts": self._halts,
            "scheduling": self._scheduling,
            "limits_passed": self._clips_passed,
            "clips": dict(self._line.arm.clips),
            "episodes": len(self._outcomes),
            "refusals": self._refusals,
            "episode_limit_s": self._episode_limit,
            "success": float(np.mean(judged)) if judged else None,
            "seconds": 0.0 if self._begun is None else self._devices.clock.now() - self._begun,
        }


def result(
    about: About, log: Path | None, watch: Watch, figures: LoopFigures, interrupted: Sequence[int]
) -> dict[str, Any]:
    """Return the result of a run as plain data.

    The result has the values of a run without episodes, which the caller replaces.

    Args:
        about: description of the loop.
        log: folder of the log, or None.
        watch: watchdog, which has the reason for the end of the run.
        figures: measurements of the loop.
        interrupted: received stop signals.
    """
    late = 1e3 * np.array(figures.late)
    return {
        "schema_version": 1,
        **about.model_dump(include={"task", "robot", "controller", "speed", "margin", "seed"}),
        "state": str(watch.state),
        "reason": watch.reason,
        "detected_to_stopped_ms": None,
        "detected_to_standing_ms": None,
        "halts": [],
        "scheduling": None,
        "periods_ms": _spread(1e3 * np.array(figures.periods)),
        "overrun_ms": _spread(late),
        "commands_late_ms": _spread(1e3 * np.array(figures.commands_late)),
        "overruns": int((late > 1e3 * watch.rules.overrun).sum()),
        "skipped_ms": 1e3 * figures.skipped,
        "cloud_ms": _spread(np.array(figures.encoding_ms))["p50"],
        "clouds_ms": _spread(np.array(figures.encoding_ms)),
        "picture_age_ms": _spread(np.array(figures.picture_age_ms)),
        "acting_ms": _spread(np.array(figures.acting_ms)),
        "limits_passed": 0,
        "clips": {},
        "refused": dict(figures.refused),
        "late_actions": figures.late_actions,
        "episodes": 0,
        "refusals": [],
        "episode_limit_s": None,
        "success": None,
        "seconds": 0.0,
        "interrupted": [signal.Signals(number).name for number in interrupted],
        "log": None if log is None else str(log),
    }


def _spread(values: np.ndarray) -> dict[str, float | None]:
    if not len(values):
        return {"p50": None, "p99": None, "worst": None}
    return {
        "p50": float(np.percentile(values, 50)),
        "p99": float(np.percentile(values, 99)),
        "worst": float(values.max()),
    }

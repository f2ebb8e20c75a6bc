"""Episodes on one line until the time is over or something ends them, and the figures of all of it."""

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
"""Seconds within which devices and controller must be ready."""
MEETING = 2.0
"""Seconds within which questions come to meet pictures; after that an episode begins all the same."""
COMING_TO_REST = 3.0
"""Seconds within which a held or stopped arm stands."""
RESUME = "r"


def _said(arm: object) -> str:
    """What a driver says of its trouble, where it says something."""
    trouble = getattr(arm, "trouble", None)
    return f": {trouble}" if trouble else ""


class SceneStage(Protocol):
    """Whoever lays a scene out, and may know whether the goal holds."""

    @property
    def is_ready(self) -> bool:
        """Whether the scene of the last reset is there."""
        ...

    @property
    def goal(self) -> bool | None:
        """Whether the task's goal holds; None: only a person can tell."""
        ...

    @property
    def at_rest(self) -> bool | None:
        """Whether the scene is at rest; None: only a person can tell."""
        ...

    def reset(self, seed: int, options: Mapping[str, Any] | None = None) -> None:
        """Begin to lay out a fresh scene; ``options`` take the place of what the seed would draw."""
        ...


@dataclass
class Devices:
    """All that a line goes between.

    Attributes:
        arm, cameras, mind, clock: as a line takes them.
        stage: who lays scenes out.
        failing: makes a device fail by the first word of a fault; real ones fail by themselves.
    """

    arm: ArmDriver
    cameras: CameraDriver
    mind: Mind
    clock: Clock
    stage: SceneStage
    failing: Mapping[str, Callable[[str], None]] = field(default_factory=dict)

    def close(self) -> None:
        """Give up all of it, whatever fails meanwhile."""
        with contextlib.ExitStack() as last_first:
            for each in (self.arm, self.cameras, self.mind):
                last_first.callback(each.close)


@dataclass(frozen=True)
class Layout:
    """A scene that is to be laid out.

    Attributes:
        seed: of what is drawn.
        options: of the reset; they take the place of what the seed would draw.
    """

    seed: int
    options: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class Ended:
    """End of an episode.

    Attributes:
        goal: whether the goal held at the end; None: only a person can tell.
        over: the controller had nothing more to do; else the goal had held for long enough, or the time was over.
        seconds: that it took.
        at_rest: whether the scene was at rest at the end; None: only a person can tell.
        lost: the goal had held for long enough, and was lost while the scene settled.
    """

    goal: bool | None
    over: bool
    seconds: float
    at_rest: bool | None = None
    lost: bool = False

    @property
    def held(self) -> bool | None:
        """Whether the goal held in a scene at rest; None: only a person can tell."""
        return None if self.goal is None else self.goal and self.at_rest is not False

    @property
    def lacking(self) -> str:
        """Why the goal did not hold in a scene at rest."""
        if self.goal:
            return "the scene did not come to rest"
        if self.lost:
            return "the goal was reached, and lost again"
        return "it gave up" if self.over else "its time was over"


class Session:
    """Episodes on one line.

    Attributes:
        in_episode: whether an episode has begun and not come to its end.
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
        self._halts: list[dict[str, Any]] = []
        self._clips_passed = 0
        self._scheduling: str | None = None
        self.in_episode = False

    # ------------------------------------------------------------------ course

    def run(
        self,
        seconds: float,
        layouts: Iterable[Layout],
        *,
        goal_ends: bool,
        ended: Callable[[Ended], None] = lambda end: None,
    ) -> None:
        """Episodes until there is no more layout, the time is over, a person or a fault ends them.

        Args:
            seconds: after which no episode goes on.
            layouts: of the episodes; the next is asked for when the one before is over.
            goal_ends: an episode is over when its goal has held for a while, and still does once the scene has settled.
            ended: is told of each that came to its end.
        """
        try:
            with self._devices.clock.punctual() as self._scheduling:
                self._go_through(seconds, layouts, goal_ends, ended)
        except GenSim2Error as error:
            self._line.watch.stop(self._devices.clock.now(), str(error), at_once=True)
            self._line.arm.release()  # no cycle follows that would send a stop

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
        """A fresh scene, and pictures of it; whether the episode can begin."""
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
        """What an episode cannot begin without."""
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
        """Run one episode and count its outcome where it came to an end; return whether the time is over."""
        line, clock, stage = self._line, self._devices.clock, self._devices.stage
        begun, held_since, lost = clock.now(), None, False
        # Control steps are stretched by the speed, and so is the task's time.
        most = self._given.spec.max_seconds * self._devices.arm.profile.control_hz / line.pace
        most -= MAX_SETTLE_SECONDS if goal_ends else 0.0  # as in a rollout, the limit leaves time to settle
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
                line.watch.rest(now)
                self._stand()
                return True
        result = Ended(stage.goal, over, clock.now() - begun, stage.at_rest, lost)
        self.in_episode = False
        self._outcomes.append(result.held)
        said = {True: "held", False: "not held", None: "over"}[result.held]
        self._progress.message(f"episode {len(self._outcomes)}: {said}")
        line.watch.rest(clock.now())
        self._stand()  # whoever is asked about the episode may take his time
        ended(result)
        return clock.now() - self._held_s > end

    def _settle(self) -> float | None:
        """Let the arm hold until the episode may be judged; return the seconds of holds. None: one is not resumed."""
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
        """Bring the arm to rest by the stop that was checked, and let it stand by its own means."""
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
        """Seconds of a hold, from ``since`` until a person resumes it: no time of the task. None: it never is."""
        self._come_to_rest()
        if not self._resumed():
            return None
        held = self._devices.clock.now() - since
        self._held_s += held
        return held

    def _resumed(self) -> bool:
        """Whether a person resumes what is held; without one, it stays held."""
        line = self._line
        if line.watch.state is not State.HOLDING or self._keys is None or not self._keys.is_there:
            return False
        self._progress.message("r resumes, any other key stops")
        while line.watch.state is State.HOLDING:
            time.sleep(CYCLE if isinstance(self._devices.clock, SimulatedClock) else 0.0)  # that of a person goes on
            self._cycle()
            if self._pressed == RESUME:
                line.resume("the keyboard")
                return True
        return False

    def _count_passed(self) -> None:
        assert self._line.commands is not None
        self._clips_passed += limits_passed(self._line.commands, self._line.arm.limits)
        self._line.commands = []

    # ------------------------------------------------------------------ report

    def report(self, about: About, log: Path | None) -> dict[str, Any]:
        """Return the result as plain data."""
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
            "success": float(np.mean(judged)) if judged else None,
            "seconds": 0.0 if self._begun is None else self._devices.clock.now() - self._begun,
        }


def result(
    about: About, log: Path | None, watch: Watch, figures: LoopFigures, interrupted: Sequence[int]
) -> dict[str, Any]:
    """Return the result of a run that made no episode and sent no command, as plain data.

    Args:
        about: of the line.
        log: its folder, if there is one.
        watch: with the reason for which the run ended.
        figures: of the loop.
        interrupted: numbers of the signals that asked to stop.
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

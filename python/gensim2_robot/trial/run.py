"""Guide a person through trials, and write the result of each trial to disk immediately (``gensim2 robot trial``)."""

from __future__ import annotations

import contextlib
import math
import signal
import threading
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, is_dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, Protocol, Unpack

import click

from gensim2.core.errors import GenSim2Error, InputError, WriteError
from gensim2.core.progress import NULL_PROGRESS, ConsoleProgress, Progress
from gensim2.core.seeding import scene_seeds
from gensim2.rollout.config import TRUE_SCENE
from gensim2.rollout.controller_spec import ControllerSpec
from gensim2.rollout.inputs import read_task_input
from gensim2_robot.config import LineArguments, LineConfig
from gensim2_robot.devices import Keys
from gensim2_robot.log import Journal
from gensim2_robot.opening import Prepared, interruptions, opened, prepare
from gensim2_robot.pipes import DeviceGoneError
from gensim2_robot.session import Ended, Layout, Session
from gensim2_robot.trial.record import (
    Placed,
    Trial,
    TrialFolder,
    TrialProtocol,
    TrialSettings,
    reset_options,
    write_table,
)


class Person(Protocol):
    """Interface to the person who lays out objects and judges results."""

    def lay_out(self, lines: Sequence[str]) -> None:
        """Ask the person to place the objects as described, and return when this is done."""
        ...

    def judge(self, question: str, offered: bool | None) -> bool:
        """Ask a yes-or-no question and return the answer. ``offered`` is the simulator's answer or None."""
        ...

    def cause(self, causes: Sequence[str]) -> str:
        """Return the cause of a failure: one of ``causes``, or a free text."""
        ...


class Terminal:
    """A person at the terminal; questions are printed on standard error.

    Args:
        keys: keyboard reader that is suspended during a question.
        progress: progress display that is hidden during a question.
    """

    def __init__(self, keys: Keys, progress: ConsoleProgress) -> None:
        self._keys, self._progress = keys, progress

    def lay_out(self, lines: Sequence[str]) -> None:
        """Show how to place the objects, and wait for Enter."""
        with self._asking():
            for line in lines:
                click.echo(line, err=True)
            click.prompt("Enter begins", default="", show_default=False, prompt_suffix=" ", err=True)

    def judge(self, question: str, offered: bool | None) -> bool:
        """Ask a question with yes or no; the simulator's answer is the default."""
        says = "" if offered is None else f" (the simulator says {'yes' if offered else 'no'})"
        with self._asking():
            return click.confirm(f"{question}{says}", default=offered, err=True)

    def cause(self, causes: Sequence[str]) -> str:
        """Ask for the cause of a failure and return it. The answer is a number from the list or free text."""
        with self._asking():
            for number, cause in enumerate(causes, 1):
                click.echo(f"  {number}  {cause}", err=True)
            while True:
                said = str(click.prompt("Why: a number, or your own words", err=True)).strip()
                if not said.isdecimal():
                    return said
                if 1 <= int(said) <= len(causes):
                    return causes[int(said) - 1]

    @contextlib.contextmanager
    def _asking(self) -> Iterator[None]:
        """Prepare the terminal for a question. The arm is released, so Ctrl-C may end the program at once."""
        with self._progress.paused(), self._keys.let_go(), _interruptible():
            yield


@contextlib.contextmanager
def _interruptible() -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


Verdict = Literal["person", "simulator"]
TRIALS = 10
"""Number of trials in the protocol of the GenSim2 paper."""


class TrialsEndedError(GenSim2Error):
    """The trials cannot continue; finished trials are kept."""


def trial(
    protocol: TrialProtocol,
    *,
    out: Path,
    trials: int = TRIALS,
    verdict: Verdict = "person",
    person: Person | None = None,
    resume: bool = False,
    logged: bool = False,
    name: str | None = None,
    keys: Keys | None = None,
    watching: Sequence[Journal] = (),
    progress: Progress = NULL_PROGRESS,
    **line: Unpack[LineArguments],
) -> dict[str, Any]:
    """Run trials of one protocol, and write the table of all trials in ``out``.

    Finished trials are kept. If the watchdog holds or stops a simulated arm, the trial has failed and the next trial
    gets new devices. A real arm ends the run in this case, because a person must check it.

    Args:
        out: output folder, with a subfolder for each task.
        verdict: who judges success: ``"person"`` or ``"simulator"``.
        person: person who lays out objects and judges; None if a simulator does both.
        resume: whether to continue the trials in the folder.
        logged: whether to write logs. A new log is started whenever the devices are opened.
        name: name of the subfolder of ``out``; None: the task's name.
        keys: keyboard with which the person resumes or stops the arm.
        watching: additional receivers of the log's data, such as a web page.
        line: see :class:`~gensim2_robot.config.LineConfig` and :class:`~gensim2.scenes.config.SceneArguments`.

    Returns:
        Table of all trials with their records, as plain data.

    Raises:
        InputError: an argument is invalid, or the folder has trials with other settings.
        WriteError: a trial cannot be written; the arm is stopped first.
        TrialsEndedError: the loop stopped before an episode, or a person must check the arm.
        KeyboardInterrupt: a stop signal arrived; the arm is stopped first.
    """
    config, scene = LineConfig.split(line)
    if verdict == "simulator" and not config.is_simulated:
        wrong = "a simulator cannot judge trials on a real arm"
        raise InputError(wrong, field="--verdict", remedy="give --verdict person")
    if person is None and verdict == "person":
        raise InputError("the name of a person must be given, because a person judges the trials", field="person")
    given = read_task_input(protocol.task, seed=config.seed, **scene)
    protocol.require(given.spec)
    told = given.spec.model_copy(update={"description": protocol.sentence})
    given = replace(given, scene=replace(given.scene, task=told))
    prepared = prepare(given, config)
    folder = out / (name or given.spec.name)
    asked = TrialSettings(
        task=given.spec.name,
        policy=_named(config),
        seed=config.seed,
        protocol=protocol.model_dump(mode="json"),
        line=_plain(config),
        scene={**given.scene.options.to_record(), "instances": given.instances},
    )
    kept = TrialFolder(folder, asked, resume)
    course = _Course(protocol, prepared, kept, trials, verdict, person, progress)
    try:
        while course.pending():
            first = course.pending()[0]
            log = folder / f"log_{first:04d}_{datetime.now(UTC):%Y%m%dT%H%M%S}" if logged else None
            with interruptions() as interrupted, contextlib.ExitStack() as stack:
                try:
                    seed = course.seeds[first]
                    there = stack.enter_context(
                        opened(prepared, log=log, watching=watching, seed=seed, interrupted=interrupted)
                    )
                except DeviceGoneError:
                    if interrupted:
                        raise KeyboardInterrupt from None
                    raise
                session = Session(there.line, there.devices, given, (), there.disk, interrupted, keys, progress)
                session.run(math.inf, course.layouts(), goal_ends=prepared.goal_ends, ended=course.ended)
            if interrupted:
                raise KeyboardInterrupt
            if course.unwritten is not None:
                raise course.unwritten
            watch = there.line.watch
            if course.current is None:
                continue
            if not session.in_episode:
                raise TrialsEndedError(f"trial {course.current.number} did not start: {watch.reason}")
            course.halted(str(watch.state), watch.reason)
            if not config.is_simulated:
                wrong = f"the watchdog changed to the state '{watch.state}'; check the arm, then continue with --resume"
                raise TrialsEndedError(wrong)
    finally:
        kept.release()
        if course.unwritten is None:
            table = write_table(out)
    return table


@dataclass(frozen=True)
class _Current:
    number: int
    placed: dict[str, Placed]


class _Course:
    """Iterates over the remaining trials and records their results."""

    def __init__(
        self,
        protocol: TrialProtocol,
        prepared: Prepared,
        kept: TrialFolder,
        trials: int,
        verdict: Verdict,
        person: Person | None,
        progress: Progress,
    ) -> None:
        self._protocol, self._kept, self._verdict, self._person = protocol, kept, verdict, person
        self._simulated, self._seed, self._progress = prepared.config.is_simulated, prepared.config.seed, progress
        self._trials = trials
        self.seeds = scene_seeds(self._seed, protocol.task, "trial", trials)
        self.current: _Current | None = None
        self.unwritten: WriteError | None = None

    def pending(self) -> list[int]:
        """Return the numbers of the remaining trials."""
        return [number for number in range(self._trials) if number not in self._kept.trials]

    def layouts(self) -> Iterator[Layout]:
        """Yield the scenes of the remaining trials; without a simulator, a person lays out each scene."""
        for number in self.pending():
            placed = self._protocol.place(self._seed, number)
            self.current = _Current(number, placed)
            if not self._simulated:
                assert self._person is not None, "a person lays out"
                what = [f"{name}: {text}" for name, text in self._protocol.objects.items()] if number == 0 else []
                where = [each.told(name) for name, each in placed.items()]
                self._person.lay_out([f"Trial {number + 1} of {self._trials}", *what, *where])
            yield Layout(self.seeds[number], reset_options(placed))

    def ended(self, end: Ended) -> None:
        cause = None
        if self._verdict == "simulator":
            success = end.held is True
            cause = None if success else end.lacking
        else:
            assert self._person is not None, "a person judges"
            success = self._person.judge(self._protocol.verdict, end.held)
            cause = None if success else self._person.cause(self._protocol.causes)
        self._keep(success, cause, self._verdict, end.goal, "idle", "episode over", end.seconds)

    def halted(self, state: str, reason: str) -> None:
        """Record the current trial as failed, because the watchdog held or stopped the arm."""
        self._keep(False, f"{state}: {reason}", "watch", None, state, reason, 0.0)

    def _keep(
        self,
        success: bool,
        cause: str | None,
        by: Literal["person", "simulator", "watch"],
        goal: bool | None,
        state: str,
        reason: str,
        seconds: float,
    ) -> None:
        assert self.current is not None, "a trial is under way"
        found = Trial(
            number=self.current.number,
            placements={name: asdict(each) for name, each in self.current.placed.items()},
            success=success,
            cause=cause,
            by=by,
            goal=goal,
            state=state,
            reason=reason,
            seconds=round(seconds, 3),
            at=datetime.now(UTC).isoformat(timespec="seconds"),
        )
        try:
            self._kept.add(found)
        except WriteError as error:
            self.unwritten = error
            raise
        self.current = None
        done = self._kept.trials.values()
        self._progress.message(f"trial {found.number + 1}: {'yes' if success else cause}")
        self._progress.message(f"{sum(each.success for each in done)} of {len(done)}")


def _named(config: LineConfig) -> str:
    policy = config.policy
    if policy is None:
        return "plan" if config.scene_source == TRUE_SCENE else f"plan, scene {config.scene_source}"
    return policy.target if isinstance(policy, ControllerSpec) else str(policy)


def _plain(config: LineConfig) -> dict[str, Any]:
    """Return all settings that resumed trials must share, as plain JSON data."""
    left_out = ("policy", "scene_source", "seed", "calibration_days")
    found: dict[str, Any] = {}
    for name, value in vars(config).items():
        if name not in left_out:
            plain = asdict(value) if is_dataclass(value) and not isinstance(value, type) else value
            found[name] = _json(plain)
    return found


def _json(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _json(each) for name, each in value.items()}
    if isinstance(value, tuple | list):
        return [_json(each) for each in value]
    return str(value) if isinstance(value, Path) else value

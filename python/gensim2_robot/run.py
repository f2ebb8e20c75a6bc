"""Run episodes on an arm until a time limit or an event, and report the results (``gensim2 robot run``)."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Unpack

from gensim2.core.errors import InputError, MissingExtraError
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.seeding import scene_seeds
from gensim2.rollout.inputs import check_counts, read_task_input
from gensim2_robot.config import LineArguments, LineConfig
from gensim2_robot.devices import Keys
from gensim2_robot.drivers.streamed import DriverError
from gensim2_robot.faults import Fault
from gensim2_robot.line import LoopFigures
from gensim2_robot.log import Journal
from gensim2_robot.opening import about_line, interruptions, opened, prepare
from gensim2_robot.pipes import DeviceGoneError
from gensim2_robot.session import Layout, Session, result
from gensim2_robot.watch import Watch

ENDLESS = 100_000
"""Number of episodes that stands for no maximum, in a run that only its time limit ends."""
MAX_MINUTES = 1e5
"""Maximum duration of a run, minutes."""


def run(
    task: str,
    *,
    minutes: float = 1.0,
    episodes: int | None = None,
    faults: Sequence[Fault] = (),
    log: Path | None = None,
    keys: Keys | None = None,
    watching: Sequence[Journal] = (),
    progress: Progress = NULL_PROGRESS,
    **line: Unpack[LineArguments],
) -> dict[str, Any]:
    """Run a policy or the planner on an arm.

    Args:
        task: name of a library task, or a folder with a task.
        minutes: time limit.
        episodes: maximum number of episodes. None: no maximum for a simulated arm, one episode for a real arm. A real
            arm that moves can run only one episode, because a person must lay out each scene.
        faults: faults to inject.
        log: folder of the log; None: no log.
        keys: keyboard with which a person resumes or stops the arm.
        watching: additional receivers of the log's data, such as a web page.
        line: see :class:`~gensim2_robot.config.LineConfig` and :class:`~gensim2.scenes.config.SceneArguments`.

    Returns:
        Result as plain data, described in docs/guides/robot.md.

    Raises:
        InputError: an argument is invalid.
        MissingExtraError: a package is not installed.
    """
    if not 0.0 < minutes < MAX_MINUTES:
        raise InputError(f"must be positive and less than {MAX_MINUTES:g}, but is {minutes}", field="minutes")
    if episodes is not None:
        check_counts(episodes=episodes)
    for fault in faults:
        if fault.name == "disk-full" and log is None:
            wrong = "the fault disk-full needs a log, because it fills the simulated disk of the log"
            raise InputError(wrong, field="fault", remedy="leave out --no-log")
    config, scene = LineConfig.split(line)
    if (episodes or 1) > 1 and not (config.is_simulated or config.dry):
        said = f"a person lays out each scene of a real arm, {episodes} are asked for"
        raise InputError(said, field="episodes", remedy="gensim2 robot trial")
    given = read_task_input(task, seed=config.seed, **scene)
    prepared = prepare(given, config, faults)
    count = episodes or (ENDLESS if config.is_simulated else 1)
    with interruptions() as interrupted, contextlib.ExitStack() as stack:
        try:
            there = stack.enter_context(opened(prepared, log=log, watching=watching, interrupted=interrupted))
        except (DeviceGoneError, DriverError, MissingExtraError) as error:
            watch = Watch()
            watch.stop(0.0, str(error))
            return result(about_line(prepared, prepared.cameras), None, watch, LoopFigures(), interrupted)
        session = Session(there.line, there.devices, given, faults, there.disk, interrupted, keys, progress)
        layouts = [Layout(seed) for seed in scene_seeds(config.seed, given.spec.name, "robot", count)]
        session.run(60.0 * minutes, layouts, goal_ends=prepared.goal_ends)
    return session.report(there.about, log)

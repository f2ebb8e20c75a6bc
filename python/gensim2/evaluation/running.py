"""Run the episodes of a table of success rates.

Seeds determine the scenes. Episodes are logged at once.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from gensim2.core.processes import Execution
from gensim2.core.progress import Progress
from gensim2.core.record_files import SCHEMA_VERSION
from gensim2.evaluation.benchmark_table import TaskRow, groups
from gensim2.rollout.config import EpisodeConfig, RolloutOptions
from gensim2.rollout.inputs import TaskInput
from gensim2.rollout.record import Episode
from gensim2.tasks.spec import TaskSpec

if TYPE_CHECKING:
    from gensim2.data.runfolder import RunFolder
    from gensim2.rollout.runner import EpisodeRunner


@dataclass(frozen=True, kw_only=True)
class Table:
    """Table of the success rates of tasks. Its ``repr`` leaves out the settings, which ``to_dict`` contains.

    Attributes:
        arguments: all settings that determine the episodes, except the tasks.
        versions: versions of the packages that affect results.
        skipped: name of each task that was not run, with the reason.
        speeds: number of episodes of this call per second of wall time, by task. None if no episode was left to run.
        cpu_s: CPU time in seconds that all worker processes of this call used, without the start of the processes.
    """

    run_dir: str
    arguments: dict[str, Any] = field(repr=False)
    versions: dict[str, str] = field(repr=False)
    rows: tuple[TaskRow, ...]
    skipped: dict[str, str]
    speeds: dict[str, float | None] = field(repr=False)
    cpu_s: float

    def to_dict(self) -> dict[str, Any]:
        return {
            "schema_version": SCHEMA_VERSION,
            "run_dir": self.run_dir,
            "arguments": self.arguments,
            "versions": self.versions,
            "tasks": [row.to_dict() for row in self.rows],
            "groups": groups(self.rows),
            "skipped": self.skipped,
            "episodes_per_second": self.speeds,
            "cpu_s": round(self.cpu_s, 3),
        }


Made = TypeVar("Made", bound=Table)


@dataclass(frozen=True)
class TableExtent:
    """Episodes of each task. There are ``runs`` runs of ``episodes`` episodes, with scenes derived from ``seed``."""

    runs: int
    episodes: int
    seed: int


Arguments = Callable[[int, int], tuple[Any, ...]]
"""Arguments of the function that runs an episode, by the episode's index and seed."""


def tabulate(
    given: Sequence[TaskInput],
    told: Mapping[str, Any],
    identity: Mapping[str, str],
    function: Callable[..., Episode],
    arguments: Callable[[TaskInput, EpisodeConfig, Path], Arguments],
    make: Callable[[Table], Made],
    *,
    command: str,
    extent: TableExtent,
    rollout: RolloutOptions,
    skipped: dict[str, str],
    execution: Execution,
    out: Path | None,
    resume: bool,
    progress: Progress,
    after: Callable[[TaskInput, RunFolder, EpisodeRunner, Sequence[Episode]], None] | None = None,
) -> Made:
    """Run all episodes of the tasks, and write a run folder with their table.

    Args:
        given: tasks to run. All tasks share the object library and the options.
        told: arguments of the command. The run's record stores these arguments and the fields of ``extent``.
        identity: digests of all inputs that determine the results.
        function: function of :mod:`gensim2.rollout.worker` that runs one episode.
        arguments: function that returns the episode arguments for a task, its configuration and its folder.
        make: function that converts the table to the result of the command.
        after: function that is called with the finished episodes of each task.
    """
    from gensim2.data.runfolder import RunFolder, default_run_dir
    from gensim2.rollout.identity import versions
    from gensim2.rollout.runner import EpisodeRunner

    options = given[0].scene.options
    asked = {"seed": extent.seed, "runs": extent.runs, "episodes": extent.episodes, **told}
    names = [one.spec.name for one in given]
    with (
        RunFolder(
            Path(out) if out is not None else default_run_dir(),
            {"command": command, "stored_tasks": names, **asked, **execution.to_record()},
            identity,
            resume,
        ) as folder,
        EpisodeRunner(options, execution, progress, rollout=rollout, log=folder.errors_log) as runner,
    ):
        rows, speeds = [], {}
        for one in given:
            name, files = one.spec.name, folder.task(one.spec.name).path
            of_task = arguments(one, runner.config(one.spec, one.instances), files)
            found, speeds[name] = run_episodes(one.spec, files, runner, function, of_task, extent, progress)
            folder.add_episodes(one.library, found, folder.path / "run.json")
            folder.save()
            rows.append(TaskRow(one.spec, extent.runs, tuple(found)))
            if after is not None:
                after(one, folder, runner, found)
        result = make(
            Table(
                run_dir=str(folder.path),
                arguments=asked,
                versions=versions(options.engine),
                rows=tuple(rows),
                skipped=skipped,
                speeds=speeds,
                cpu_s=runner.cpu_s,
            )
        )
        finish_table(folder, result.to_dict())
    return result


def run_episodes(
    task: TaskSpec,
    folder: Path,
    runner: EpisodeRunner,
    function: Callable[..., Episode],
    arguments: Arguments,
    extent: TableExtent,
    progress: Progress,
) -> tuple[list[Episode], float | None]:
    """Run the episodes of a task that are not in its log; return all episodes, and the number of episodes per second.

    A benchmark and an evaluation with the same seed have the same scenes.

    Args:
        folder: folder of the task, with the log.
        function: function of :mod:`gensim2.rollout.worker`.
    """
    from gensim2.core.seeding import scene_seeds
    from gensim2.rollout.episode_log import ATTEMPTS, EpisodeLog

    purposes = [f"benchmark/{run}" for run in range(extent.runs)]
    seeds = [each for one in purposes for each in scene_seeds(extent.seed, task.name, one, extent.episodes)]
    log = EpisodeLog(folder / ATTEMPTS, seeds)
    progress.start(task.name, len(seeds))
    progress.advance(len(log.done))
    begin, missing = time.perf_counter(), len(seeds) - len(log.done)
    jobs = [arguments(index, each) for index, each in enumerate(seeds)]
    runner.episodes(f"{task.name}: episodes", jobs, function, log)
    speed = round(missing / (time.perf_counter() - begin), 4) if missing else None
    return log.finish(len(seeds)), speed


def finish_table(folder: RunFolder, told: dict[str, Any]) -> None:
    """Write the result of a table into its run folder, and finish the run.

    The table does not contain ``provenance``, so that date and command do not matter, nor ``records``, which are stored
    with the tasks.

    Args:
        told: result as JSON data; the function does not modify it.
    """
    tasks = [{name: value for name, value in task.items() if name != "records"} for task in told["tasks"]]
    folder.finish({name: value for name, value in {**told, "tasks": tasks}.items() if name != "provenance"})

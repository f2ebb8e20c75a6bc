"""``gensim2 benchmark``: the task library in the paper's protocol, several runs of many random episodes a task."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import mean, pstdev
from typing import Any

from gensim2.episodes.disturbance import KINDS, Kind
from gensim2.episodes.record import Episode
from gensim2.errors import InputError
from gensim2.objects import open_library
from gensim2.pipeline.inputs import TaskInput, check_counts, check_workers, of_these_objects, read_task_input
from gensim2.pipeline.records import SCHEMA_VERSION
from gensim2.pipeline.setting import Physics
from gensim2.pipeline.tally import Tally, interval
from gensim2.processes import JOBS_PER_WORKER, TIME_LIMIT
from gensim2.progress import NULL_PROGRESS, Progress
from gensim2.robots import DEFAULT_ROBOT
from gensim2.tasks.published import PAPER


@dataclass(frozen=True)
class TaskRow:
    """One task in the table; all of it follows from ``episodes``.

    Attributes:
        name: of the task.
        is_single_step: whether it has one step.
        runs: number of runs, each of equally many episodes.
        episodes: in the order of runs.
    """

    name: str
    is_single_step: bool
    runs: int
    episodes: tuple[Episode, ...]

    def rates(self, verdict: str) -> list[float]:
        """Share of episodes that fulfil ``"paper"``, ``"held"`` or ``"strict"``, one a run."""
        size = len(self.episodes) // self.runs
        flags = [bool(getattr(episode, verdict)) for episode in self.episodes]
        return [mean(flags[run * size : (run + 1) * size]) for run in range(self.runs)]

    @property
    def tally(self) -> Tally:
        """Counts over all runs."""
        return Tally.of(self.episodes)

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data; ``success`` is the verdict that the paper counts."""
        tally, paper = self.tally, self.rates("paper")
        published = PAPER.get(self.name)
        return {
            "name": self.name,
            "type": "single-step" if self.is_single_step else "long-horizon",
            "episodes": tally.episodes,
            "success_mean": mean(paper),
            "success_std": pstdev(paper),
            "held_mean": mean(self.rates("held")),
            "held_interval": list(interval(tally.held, tally.episodes)),
            "strict_mean": mean(self.rates("strict")),
            "partial": tally.partial,
            "replanned": tally.replanned,
            "still": tally.still,
            "paper_figure": None if published is None else published[0],
            "causes": tally.causes,
            "strict_misses": tally.strict_misses,
            "objects": tally.objects,
            "records": [episode.to_dict() for episode in self.episodes],
        }


@dataclass(frozen=True)
class BenchmarkResult:
    """The table.

    Attributes:
        run_dir: the run folder.
        rows: one a task.
        skipped: tasks that could not be run on these objects, with the reason.
        cpu_s: CPU of all processes in this call, their start apart.
    """

    run_dir: str
    rows: tuple[TaskRow, ...]
    skipped: dict[str, str]
    cpu_s: float

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "schema_version": SCHEMA_VERSION,
            "run_dir": self.run_dir,
            "tasks": [row.to_dict() for row in self.rows],
            "skipped": self.skipped,
            "cpu_s": round(self.cpu_s, 3),
        }


def benchmark(
    tasks: Sequence[str] = (),
    *,
    runs: int = 5,
    episodes: int = 50,
    seed: int = 0,
    assets: str | Path | None = None,
    instances: str = "all",
    physics: Physics = "ours",
    robot: str = DEFAULT_ROBOT,
    open_loop: bool = False,
    disturbance: Kind | None = None,
    out: Path | None = None,
    workers: int = 2,
    resume: bool = False,
    time_limit: float = TIME_LIMIT,
    jobs_per_worker: int = JOBS_PER_WORKER,
    progress: Progress = NULL_PROGRESS,
) -> BenchmarkResult:
    """Run every task on random scenes; each episode is kept as soon as it is finished.

    Args:
        tasks: names of library tasks, or folders that hold task.yaml and strategies/; none: the whole library.
        runs: repetitions, for the deviation between them.
        episodes: of each task in each run.
        seed: of the scenes; no search draws from the same ones.
        assets, instances, physics, robot, open_loop: as for ``demo``.
        disturbance: ``"push"`` or ``"drop"``, once an episode at a seeded moment.
        out: run folder; default ``runs/<date>-<time>``.
        workers: simulator processes; the table does not depend on their number.
        resume: go on with the run that ``out`` holds.
        time_limit, jobs_per_worker: as for ``demo``.
        progress: listener.

    Raises:
        InputError: an argument cannot be used.
        NotRunError: some episodes could not be run; all others are finished, and ``resume`` goes on.
    """
    check_counts(runs=runs, episodes=episodes, workers=workers)
    check_workers(time_limit, jobs_per_worker)
    if disturbance is not None and disturbance not in KINDS:
        raise InputError(f"no disturbance {disturbance!r}", field="disturbance", remedy=f"one of {', '.join(KINDS)}")
    library = open_library(assets)
    wanted, skipped = (tuple(tasks), {}) if tasks else of_these_objects(assets)
    given: list[TaskInput] = []
    for task in wanted:
        one = read_task_input(task, assets, instances, seed, physics=physics, robot=robot, open_loop=open_loop)
        given.append(replace(one, circumstances=replace(one.circumstances, disturbance=disturbance)))
    names = [one.spec.name for one in given]
    if len(set(names)) < len(names):
        raise InputError("a task is named twice", field="tasks")
    # Only now what takes long to import.
    from gensim2.pipeline.evaluator import PoolEvaluator
    from gensim2.pipeline.runfolder import RunFolder, default_run_dir, digest, listing

    circumstances = given[0].circumstances
    classes = sorted({thing.asset_class for one in given for thing in one.spec.objects.values()})
    with (
        RunFolder(
            Path(out) if out is not None else default_run_dir(),
            {
                "command": "benchmark",
                "stored_tasks": names,
                "runs": runs,
                "episodes": episodes,
                "seed": seed,
                **asdict(circumstances),
                "instances": instances,
                "workers": workers,
            },
            {
                "tasks": digest([one.spec.model_dump(mode="json") for one in given]),
                "strategies": digest([one.strategies for one in given]),
                "objects": listing(library, classes),
            },
            resume,
        ) as folder,
        PoolEvaluator(
            circumstances,
            workers,
            progress,
            time_limit=time_limit,
            jobs_per_worker=jobs_per_worker,
            log=folder.errors_log,
        ) as evaluator,
    ):
        rows = []
        for one in given:
            found = _episodes(one, evaluator, folder.task(one.spec.name).path, runs, episodes, seed, progress)
            folder.add_episodes(library, found, folder.path / "run.json")
            folder.save()
            rows.append(TaskRow(one.spec.name, one.spec.is_single_step, runs, tuple(found)))
        result = BenchmarkResult(str(folder.path), tuple(rows), skipped, evaluator.cpu_s)
        folder.finish({**result.to_dict(), "tasks": [_without_records(row) for row in rows]})
    return result


def _without_records(row: TaskRow) -> dict[str, Any]:
    return {name: value for name, value in row.to_dict().items() if name != "records"}


def _episodes(
    given: TaskInput, evaluator: Any, folder: Path, runs: int, episodes: int, seed: int, progress: Progress
) -> list[Episode]:
    """All episodes of a task, run after run; those that its log holds are not run again."""
    from gensim2.pipeline import worker
    from gensim2.pipeline.attempts import ATTEMPTS, AttemptLog, LoggedEpisode
    from gensim2.processes import Job
    from gensim2.seeding import scene_seeds

    task = given.spec
    seeds = [each for run in range(runs) for each in scene_seeds(seed, task.name, f"benchmark/{run}", episodes)]
    log = AttemptLog(folder / ATTEMPTS, seeds)
    progress.start(task.name, len(seeds))
    progress.advance(len(log.done))
    setting = evaluator.setting(task, given.instances)
    jobs = [Job(i, (setting, given.strategies, seeds[i])) for i in range(len(seeds)) if i not in log.done]
    for index, episode in evaluator.run(worker.episode, jobs, f"{task.name}: episodes"):
        log.add(LoggedEpisode.of(episode, index))
        progress.advance()
    return [entry.episode for entry in log.finish(len(seeds))]

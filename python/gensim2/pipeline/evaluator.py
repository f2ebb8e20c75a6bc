"""The simulator behind the search: an executor whose workers share nothing."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from gensim2.pipeline import worker
from gensim2.pipeline.records import Attempt
from gensim2.processes import (
    JOBS_PER_WORKER,
    TIME_LIMIT,
    Executor,
    Failure,
    Job,
    WorkerPool,
    enumerated,
    results,
)
from gensim2.progress import NULL_PROGRESS, Progress
from gensim2.tasks.spec import TaskSpec

Result = TypeVar("Result")


class PoolEvaluator:
    """Plans and runs episodes in worker processes; what comes of them does not depend on their number.

    A context manager: leaving it ends the workers.

    Args:
        assets: ``"builtin"`` or the path of a folder of objects.
        workers: number of processes.
        progress: is advanced once a job; whoever calls starts the stage.
        instances: which instances episodes draw from, as in ``GenSim2Env``.
        time_limit: seconds after which a job counts as hung and is tried again.
        jobs_per_worker: jobs after which a process is renewed.
        log: file for tries that came to nothing, with their tracebacks; None keeps none.
    """

    def __init__(
        self,
        assets: str,
        workers: int,
        progress: Progress = NULL_PROGRESS,
        instances: str = "all",
        *,
        time_limit: float = TIME_LIMIT,
        jobs_per_worker: int = JOBS_PER_WORKER,
        log: Path | None = None,
    ) -> None:
        self.assets, self.instances = assets, instances
        self._progress, self._log = progress, log
        self._executor: Executor = WorkerPool(
            workers,
            time_limit=time_limit,
            jobs_per_worker=jobs_per_worker,
            preload=worker.PRELOAD,
            on_failure=self._failed,
        )

    def __enter__(self) -> PoolEvaluator:
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.close()

    def setting(self, task: TaskSpec) -> worker.Setting:
        """Return the environment of a task, as a value that pickles."""
        return worker.Setting(task.model_dump_json(), self.assets, self.instances)

    def run(
        self, function: Callable[..., Result], jobs: Iterable[Job | None], what: str
    ) -> Iterator[tuple[int, Result]]:
        """Yield (index, result) of jobs as they are finished, in any order.

        Args:
            function: of :mod:`gensim2.pipeline.worker`.
            jobs: as in ``Executor.map_unordered``.
            what: the jobs are, for messages.

        Raises:
            NotRunError: some could not be run, after all others.
            InputError: what a job said of its input, after all others.
        """
        return results(self._executor.map_unordered(function, jobs), what, self._log)

    def screen(
        self, task: TaskSpec, configs: Sequence[Mapping[str, Any]], seeds: Sequence[int]
    ) -> list[list[worker.Screened]]:
        """Plan each config on each seed's scene; one list a config, one (score, cause) a seed."""
        setting = self.setting(task)
        jobs = enumerated((setting, seed, configs) for seed in seeds)
        by_seed: dict[int, list[worker.Screened]] = {}
        for index, screened in self.run(worker.screen_scene, jobs, f"{task.name}: planning of candidates"):
            by_seed[index] = screened
            self._progress.advance()
        return [list(outcomes) for outcomes in zip(*(by_seed[index] for index in range(len(seeds))), strict=True)]

    def attempt(self, task: TaskSpec, jobs: Sequence[tuple[Mapping[str, Any], int]]) -> list[Attempt]:
        """Run (config, seed) episodes in physics; the attempts in the order of the jobs."""
        setting = self.setting(task)
        numbered = enumerated((setting, config, seed) for config, seed in jobs)
        found: dict[int, Attempt] = {}
        for index, attempt in self.run(worker.attempt, numbered, f"{task.name}: episodes"):
            found[index] = attempt
            self._progress.advance()
        return [found[index] for index in range(len(jobs))]

    def _failed(self, failure: Failure) -> None:
        self._progress.message(f"try {failure.number} of job {failure.index} came to nothing: {failure.reason}")
        if self._log is None:
            return
        self._log.parent.mkdir(parents=True, exist_ok=True)
        with self._log.open("a", encoding="utf-8") as stream:
            now = time.strftime("%Y-%m-%dT%H:%M:%S%z")
            stream.write(
                f"{now} job {failure.index}, try {failure.number}: {failure.reason}\n{failure.traceback or ''}"
            )

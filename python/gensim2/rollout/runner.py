"""The simulator behind the search: an executor whose workers share nothing."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

from gensim2.core.files import append
from gensim2.core.processes import Execution, Executor, Failure, Job, Outcome, enumerated, results
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.rollout import worker
from gensim2.rollout.config import DEFAULT_ROLLOUT, EpisodeConfig, RolloutOptions
from gensim2.rollout.record import Episode
from gensim2.scenes.config import Drawn, SceneOptions
from gensim2.tasks.spec import TaskSpec
from gensim2.tasks.strategies import StepStrategies

Result = TypeVar("Result")


class EpisodeRunner:
    """Plans and runs episodes in worker processes; what comes of them does not depend on their number.

    A context manager: leaving it ends the workers.

    Args:
        scene: what the scenes of all tasks follow from.
        execution: where and how the jobs run.
        progress: is advanced once a job; whoever calls starts the stage.
        rollout: what all episodes have in common beside their scenes.
        log: file for tries that came to nothing, with their tracebacks; None keeps none.

    Attributes:
        failed_tries: tries that came to nothing.
    """

    def __init__(
        self,
        scene: SceneOptions,
        execution: Execution,
        progress: Progress = NULL_PROGRESS,
        *,
        rollout: RolloutOptions = DEFAULT_ROLLOUT,
        log: Path | None = None,
    ) -> None:
        self.scene, self.rollout = scene, rollout
        self.failed_tries = 0
        self._progress, self._log = progress, log
        self._executor = execution.executor(
            preload=worker.PRELOAD[scene.engine],
            prepare=partial(worker.prepare, scene),
            on_failure=self._failed,
        )
        self._begin, self._elsewhere = time.process_time(), 0.0

    def __enter__(self) -> EpisodeRunner:
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.close()
        worker.forget()  # of episodes that ran in this process

    @property
    def executor(self) -> Executor:
        """Executor of the jobs."""
        return self._executor

    @property
    def cpu_s(self) -> float:
        """Seconds of CPU since this was made: of this process, and of the workers' jobs without the workers' start."""
        return time.process_time() - self._begin + self._elsewhere

    def config(self, task: TaskSpec, instances: Drawn) -> EpisodeConfig:
        """Return what the episodes of a task follow from, as a value that pickles."""
        return EpisodeConfig(self.scene.with_task(task, instances), self.rollout)

    def run(
        self, function: Callable[..., Result], jobs: Iterable[Job | None], what: str
    ) -> Iterator[tuple[int, Result]]:
        """Yield (index, result) of jobs as they are finished, in any order.

        Args:
            function: of :mod:`gensim2.rollout.worker`.
            jobs: as in ``Executor.map_unordered``.
            what: the jobs are, for messages.

        Raises:
            NotRunError: some could not be run, after all others.
            InputError: what a job said of its input, after all others.
        """
        return results(self._counted(self._executor.map_unordered(function, jobs)), what, self._log)

    def _counted(self, outcomes: Iterable[Outcome[Result]]) -> Iterator[Outcome[Result]]:
        for outcome in outcomes:
            self._elsewhere += outcome.cpu_s
            yield outcome

    def screen(
        self, config: EpisodeConfig, candidates: Sequence[StepStrategies], seeds: Sequence[int]
    ) -> list[list[worker.Screened]]:
        """Plan each candidate on each seed's scene; one list a candidate, one result a seed."""
        jobs = enumerated((config, seed, candidates) for seed in seeds)
        by_seed: dict[int, list[worker.Screened]] = {}
        for index, screened in self.run(worker.screen_scene, jobs, f"{config.task.name}: planning of candidates"):
            by_seed[index] = screened
            self._progress.advance()
        return [list(outcomes) for outcomes in zip(*(by_seed[index] for index in range(len(seeds))), strict=True)]

    def episodes(self, config: EpisodeConfig, jobs: Sequence[tuple[StepStrategies, int]]) -> list[Episode]:
        """Run (strategies of each step, seed) episodes in physics; their records in the order of the jobs."""
        numbered = enumerated((config, ways, seed) for ways, seed in jobs)
        found: dict[int, Episode] = {}
        for index, episode in self.run(worker.trial, numbered, f"{config.task.name}: episodes"):
            found[index] = episode
            self._progress.advance()
        return [found[index] for index in range(len(jobs))]

    def _failed(self, failure: Failure) -> None:
        self.failed_tries += 1
        self._progress.message(f"try {failure.number} of job {failure.index} came to nothing: {failure.reason}")
        if self._log is None:
            return
        self._log.parent.mkdir(parents=True, exist_ok=True)
        now = time.strftime("%Y-%m-%dT%H:%M:%S%z")
        said = f"job {failure.index}, try {failure.number}: {failure.reason}\n{failure.traceback or ''}"
        append(self._log, f"{now} {said}")

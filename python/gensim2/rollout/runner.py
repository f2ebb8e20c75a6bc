"""Run episodes in worker processes; each process has its own simulator."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter

from gensim2.core.errors import GenSim2Error, InputError
from gensim2.core.files import write_json
from gensim2.core.foreign.limits import MAX_RECORD
from gensim2.core.foreign.tree import read_input
from gensim2.core.processes import Execution, Executor, Failure, Job, Outcome, results
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.record_files import parse_record
from gensim2.rollout import worker
from gensim2.rollout.config import DEFAULT_ROLLOUT, EpisodeConfig, RolloutOptions
from gensim2.rollout.episode_log import EpisodeLog
from gensim2.rollout.record import Episode
from gensim2.scenes.config import Drawn, SceneOptions
from gensim2.tasks.spec import TaskSpec
from gensim2.tasks.strategies import StepStrategies

Result = TypeVar("Result")

_SCREENED: TypeAdapter[list[worker.Screened]] = TypeAdapter(list[worker.Screened])
_REMEDY = "delete the file and resume; its candidates are planned again"


class EpisodeRunner:
    """Context manager that plans and runs episodes in any number of workers. Their number does not change the results.

    Args:
        scene: settings of the scenes of all tasks.
        execution: settings of the workers.
        progress: progress display, which advances after each job; the caller starts each stage.
        rollout: options of all episodes.
        log: file to which the tracebacks of failed jobs are written; None for no log.

    Attributes:
        failed_tries: number of times that a job failed. A job that is repeated can fail several times.
        workers: number of processes that run jobs at the same time; 1 if Ray chooses the number.
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
        self.workers = execution.workers or 1
        self._progress, self._log = progress, log
        scenes = scene.in_engines(rollout.engines)
        self._executor = execution.executor(
            preload=tuple(dict.fromkeys(name for each in scenes for name in worker.PRELOAD[each.engine])),
            prepare=partial(worker.prepare, scenes),
            on_failure=self._failed,
        )
        self._begin, self._elsewhere = time.process_time(), 0.0

    def __enter__(self) -> EpisodeRunner:
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.close()
        worker.forget()  # close the controller that this process has kept open

    @property
    def executor(self) -> Executor:
        return self._executor

    @property
    def cpu_s(self) -> float:
        """CPU time (s) of this process and all jobs since the runner was created, without the start of the workers."""
        return time.process_time() - self._begin + self._elsewhere

    def config(self, task: TaskSpec, instances: Drawn) -> EpisodeConfig:
        """Return the configuration of a task's episodes, as a value that can be pickled."""
        return EpisodeConfig(self.scene.with_task(task, instances), self.rollout)

    def run(
        self, function: Callable[..., Result], jobs: Iterable[Job | None], what: str
    ) -> Iterator[tuple[int, Result]]:
        """Run jobs in the worker processes. Yield the index and the result of each job as soon as the job has finished.

        Args:
            function: function of :mod:`gensim2.rollout.worker`.
            jobs: jobs with indices and arguments. The iterator yields None while its next job depends on a missing
                result.
            what: name of the jobs in messages to the user.

        Raises:
            NotRunError: some jobs could not be run; raised after all other jobs.
            InputError: the input of a job is invalid; raised after all other jobs.
        """
        return results(self._counted(self._executor.map_unordered(function, jobs)), what, self._log)

    def _counted(self, outcomes: Iterable[Outcome[Result]]) -> Iterator[Outcome[Result]]:
        for outcome in outcomes:
            self._elsewhere += outcome.cpu_s
            yield outcome

    def each(
        self, function: Callable[..., Result], jobs: Mapping[int, tuple[Any, ...]], what: str
    ) -> Iterator[tuple[int, Result]]:
        """Yield (index, result) as :meth:`run` does, and advance the progress after each job.

        Args:
            function: function of :mod:`gensim2.rollout.worker`.
            jobs: arguments by index.
            what: name of the jobs for messages.
        """
        numbered = (Job(index, arguments) for index, arguments in jobs.items())
        for index, found in self.run(function, numbered, what):
            yield index, found
            self._progress.advance()

    def make_films(
        self, function: Callable[..., Result], jobs: Mapping[int, tuple[Any, ...]], what: str
    ) -> list[Result]:
        """Run the jobs of a stage ``what`` and return their results; errors are only shown, so they hide no results."""
        made: list[Result] = []
        if jobs:
            self._progress.start(what, len(jobs))
        try:
            made.extend(found for _, found in self.each(function, jobs, what))
        except GenSim2Error as error:
            self._progress.message(f"{what}: not all were made: {error}")
        return made

    def screen(
        self, config: EpisodeConfig, candidates: Sequence[StepStrategies], seeds: Sequence[int], log: Path | None = None
    ) -> list[list[worker.Screened]]:
        """Plan each candidate in the scene of each seed, and return for each candidate a list with one result per seed.

        Args:
            config: configuration of the scenes.
            seeds: seeds of the scenes.
            log: folder that stores the results of each seed as JSON; seeds with stored results are not planned again.
        """
        files = {seed: log / f"{seed}.json" for seed in seeds} if log is not None else {}
        by_seed: dict[int, list[worker.Screened]] = {}
        for seed, file in files.items():
            if file.exists():
                content = read_input(file, MAX_RECORD, _REMEDY)
                by_seed[seed] = parse_record(content, _SCREENED, file, _REMEDY)
                if len(by_seed[seed]) != len(candidates):
                    raise InputError("belongs to another run", file=file, remedy=_REMEDY)
                self._progress.advance()
        jobs = {n: (config, seed, candidates) for n, seed in enumerate(seeds) if seed not in by_seed}
        for n, found in self.each(worker.screen_scene, jobs, f"{config.task.name}: planning of candidates"):
            by_seed[seeds[n]] = found
            if files:
                files[seeds[n]].parent.mkdir(parents=True, exist_ok=True)
                write_json(files[seeds[n]], found)
        return [list(outcomes) for outcomes in zip(*(by_seed[seed] for seed in seeds), strict=True)]

    def trials(
        self, config: EpisodeConfig, jobs: Sequence[tuple[StepStrategies, int]], log: EpisodeLog | None = None
    ) -> list[Episode]:
        """Run an episode for each job, which has strategies by step and a seed.

        The log and the order are the same as in :meth:`episodes`.
        """
        return self.episodes(
            f"{config.task.name}: episodes", [(config, ways, seed) for ways, seed in jobs], worker.trial, log
        )

    def episodes(
        self,
        what: str,
        jobs: Sequence[tuple[Any, ...]],
        function: Callable[..., Episode] | None = None,
        log: EpisodeLog | None = None,
    ) -> list[Episode]:
        """Run one episode per job, and return the records in the order of the jobs.

        Args:
            what: name of the episodes for messages.
            jobs: arguments of ``function``.
            function: function of :mod:`gensim2.rollout.worker`; None: ``episode``.
            log: log that stores each finished episode; logged episodes are not run again.
        """
        done = {} if log is None else log.done
        missing = {index: arguments for index, arguments in enumerate(jobs) if index not in done}
        for index, found in self.each(function or worker.episode, missing, what):
            if log is None:
                done[index] = found
            else:
                log.add(index, found)
        return [done[index] for index in range(len(jobs))]

    def _failed(self, failure: Failure) -> None:
        self.failed_tries += 1
        failure.report(self._progress, self._log)

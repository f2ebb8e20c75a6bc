"""Worker processes on this machine that share nothing.

Each simulator wants a process of its own: SAPIEN runs one environment a process on the CPU.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from multiprocessing.connection import wait
from typing import Any, TypeVar

from gensim2.core.errors import GenSim2Error
from gensim2.core.processes.executor import Executor, Failure, Job, Outcome, Tries
from gensim2.core.processes.worker import Worker, preload_modules

Result = TypeVar("Result")

TIME_LIMIT = 900.0
"""Seconds after which a job counts as hung."""

JOBS_PER_WORKER = 500
"""Jobs after which a worker process is renewed, so that what libraries leak does not grow."""


class WorkerPool(Executor):
    """A fixed number of worker processes.

    Ctrl-C in the parent ends the workers at once and leaves the ``with`` block; whatever was yielded before
    is whole.

    Args:
        workers: number of processes; 0 runs the jobs in this process, where a bug is raised as it is, which helps
            when debugging.
        time_limit: seconds after which a job counts as hung and its worker is replaced.
        jobs_per_worker: jobs after which a process is renewed.
        preload: modules that jobs need and that take long to import; they are imported once for all workers. What
            the first pool of this process says holds for those after it.
        prepare: is called in each process before its first job, and belongs to the process's start; must pickle.
        on_failure: is told of each try that came to nothing, also where a later one succeeds.
    """

    def __init__(
        self,
        workers: int,
        *,
        time_limit: float = TIME_LIMIT,
        jobs_per_worker: int = JOBS_PER_WORKER,
        preload: Sequence[str] = (),
        prepare: Callable[[], object] | None = None,
        on_failure: Callable[[Failure], None] | None = None,
    ) -> None:
        if workers < 0:
            raise ValueError(f"workers must not be negative, is {workers}")
        super().__init__(on_failure)
        preload_modules(preload)
        self._workers = [Worker(time_limit, jobs_per_worker, prepare) for _ in range(workers)]

    def close(self) -> None:
        for worker in self._workers:
            worker.stop()

    def map_unordered(self, function: Callable[..., Result], jobs: Iterable[Job | None]) -> Iterator[Outcome[Result]]:
        if self._workers:
            yield from super().map_unordered(function, jobs)
            return
        for job in jobs:
            if job is None:  # none now, and none under way that could change that
                return
            yield _run_here(function, job)

    def _is_busy(self, _: Tries) -> bool:
        return any(worker.job for worker in self._workers)

    def _abandon(self) -> None:
        for worker in self._workers:
            if worker.job is not None:
                worker.stop()

    def _dispatch(self, function: Callable[..., Any], tries: Tries) -> None:
        for worker in self._workers:
            if worker.job is None:
                job = tries.next()
                if job is None:
                    return
                worker.send(job, function, fresh=tries.number(job) > 1)

    def _collect(self, tries: Tries) -> list[Outcome[Any]]:
        busy = [(worker, worker.job) for worker in self._workers if worker.job is not None]
        patience = min(worker.deadline for worker, _ in busy) - time.monotonic()
        # A dead worker's connection reads as ended, so waiting on connections covers crashes as well.
        ready = wait([worker.connection for worker, _ in busy], timeout=max(patience, 0.0))
        outcomes: list[Outcome[Any]] = []
        for worker, job in busy:
            number = tries.number(job)
            if worker.connection in ready:
                found = worker.receive(number)
            elif time.monotonic() >= worker.deadline:
                found = worker.give_up(number)
            else:
                continue
            if found is not None:
                outcomes.extend(tries.over(job, found))
        return outcomes


def _run_here(function: Callable[..., Result], job: Job) -> Outcome[Result]:
    try:
        return Outcome(job.index, function(*job.arguments))
    except GenSim2Error as error:
        return Outcome(job.index, error=error)

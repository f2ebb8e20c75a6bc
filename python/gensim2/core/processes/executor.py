"""Define the interface of executors, and the outcomes of jobs.

A job is a pure function of its arguments, with the same result in every attempt and on any machine. If its process
dies, the job is run again. A ``GenSim2Error`` is the outcome of a job. Any other exception is a bug, and the attempt
has failed.
"""

from __future__ import annotations

import pickle
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Self, TypeVar

from gensim2.core.errors import GenSim2Error, NotRunError, WriteError
from gensim2.core.files import append
from gensim2.core.progress import Progress, now

Result = TypeVar("Result")

TRIES = 3
"""Maximum number of attempts to run a job."""


class WorkerStartError(GenSim2Error):
    """A worker ended before its first job. New workers would end in the same way, so no job can run."""


@dataclass(frozen=True)
class Job:
    """Arguments of one function call, with an index chosen by the caller."""

    index: int
    arguments: tuple[Any, ...]


@dataclass(frozen=True)
class Failure:
    """A failed attempt of a job.

    Attributes:
        index: index of the job.
        number: number of the attempt, from 1.
        reason: reason on one line.
        traceback: traceback of an exception in the worker.
    """

    index: int
    number: int
    reason: str
    traceback: str | None = None

    def report(self, progress: Progress, log: Path | None) -> None:
        """Show the failure, and append it with its traceback to the file ``log``."""
        progress.message(f"job {self.index} failed on attempt {self.number}: {self.reason}")
        if log is not None:
            log.parent.mkdir(parents=True, exist_ok=True)
            append(log, f"{now()} job {self.index}, try {self.number}: {self.reason}\n{self.traceback or ''}")


@dataclass(frozen=True)
class Outcome(Generic[Result]):
    """Outcome of one job: either a result, an error, or failures.

    Attributes:
        index: index of the job.
        result: return value of the function.
        error: ``GenSim2Error`` that the function raised.
        failures: one failure for each attempt, if all attempts failed.
        cpu_s: CPU time of the worker process in the last attempt, s; 0 if the job ran in the caller's process.
    """

    index: int
    result: Result | None = None
    error: GenSim2Error | None = None
    failures: tuple[Failure, ...] = ()
    cpu_s: float = 0.0

    def unwrap(self) -> Result:
        """Return the result.

        Raises:
            GenSim2Error: the job's function raised this error.
            NotRunError: the job could not be run.
        """
        if self.error is not None:
            raise self.error
        if self.failures:
            raise NotRunError("job", {self.index: self.failures[-1].reason})
        return self.result  # type: ignore[return-value]


HOPELESS = 3
"""If this many jobs fail in all attempts before any job finishes, the remaining jobs are not tried."""


class Tries:
    """Jobs of one call of ``map_unordered``, with a record of the failed attempts of each job.

    Args:
        jobs: jobs of the call.
        on_failure: callback for each failed attempt, even if a later attempt succeeds.
        ran: whether any job has finished in an earlier call.

    Attributes:
        ran: whether any job has finished so far, in this call or in an earlier call.
    """

    def __init__(
        self, jobs: Iterable[Job | None], on_failure: Callable[[Failure], None] | None, ran: bool = False
    ) -> None:
        self._jobs, self._on_failure = iter(jobs), on_failure
        self._again: deque[Job] = deque()
        self._failures: dict[int, list[Failure]] = {}
        self._given_up = 0
        self._exhausted, self.ran = False, ran

    def peek(self) -> Job | None:
        """Return the job that :meth:`next` will return next, without removing it."""
        job = self.next()
        if job is not None:
            self._again.appendleft(job)
        return job

    def next(self) -> Job | None:
        """Return a job to run now, or None if no job is available at the moment."""
        if self._again:
            return self._again.popleft()
        if self._exhausted:
            return None
        try:
            return next(self._jobs)
        except StopIteration:
            self._exhausted = True
            return None

    def number(self, job: Job) -> int:
        """Return the number of the current attempt of ``job``, counted from 1."""
        return len(self._failures.get(job.index, ())) + 1

    def over(self, job: Job, found: Outcome[Any] | Failure) -> list[Outcome[Any]]:
        """Record the result of an attempt. Return the outcomes of the jobs that are now finished."""
        if isinstance(found, Failure):
            return self._failed(found, job)
        self.ran = True
        self._failures.pop(job.index, None)
        return [found]

    def _failed(self, failure: Failure, job: Job) -> list[Outcome[Any]]:
        if self._on_failure is not None:
            self._on_failure(failure)
        failures = self._failures.setdefault(job.index, [])
        failures.append(failure)
        if len(failures) < TRIES:
            self._again.append(job)
            return []
        self._given_up += 1
        outcomes: list[Outcome[Any]] = [Outcome(job.index, failures=tuple(self._failures.pop(job.index)))]
        if self._given_up == HOPELESS and not self.ran:
            reason = f"not tried, because none before it could be run: {failure.reason}"
            outcomes.extend(Outcome(rest.index, failures=(Failure(rest.index, 0, reason),)) for rest in self._rest())
        return outcomes

    def _rest(self) -> Iterator[Job]:
        """Yield the remaining jobs, until no job is left or the next job depends on an unknown outcome."""
        while (job := self.next()) is not None:
            yield job


class Executor(ABC):
    """Context manager that runs jobs; leaving it ends all running jobs.

    Args:
        on_failure: callback for each failed attempt, even if a later one succeeds.
    """

    def __init__(self, on_failure: Callable[[Failure], None] | None) -> None:
        self._on_failure = on_failure
        self._ran = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def map_unordered(self, function: Callable[..., Result], jobs: Iterable[Job | None]) -> Iterator[Outcome[Result]]:
        """Yield the outcome of ``function(*job.arguments)`` for every job, as soon as the job is finished.

        A job that fails is attempted ``TRIES`` times, each time in a new process. Running jobs end if the iteration is
        stopped.

        Args:
            function: function of a module, so that it is pickled by name.
            jobs: iterable of jobs. The executor takes the next job when a worker becomes free. If the next job depends
                on the outcome of a running job, the iterable yields None, and the executor asks for the job again after
                the next outcome. If the iterable yields None while no job is running, the iteration ends.

        Raises:
            WorkerStartError: worker processes cannot start.
            NotRunError: the head of a Ray cluster is gone.
        """
        tries = Tries(jobs, self._on_failure, self._ran)
        finished: deque[Outcome[Result]] = deque()
        try:
            while True:
                self._dispatch(function, tries)
                if finished:
                    yield finished.popleft()
                elif self._is_busy(tries):
                    finished.extend(self._collect(tries))
                    self._ran = tries.ran
                else:
                    return
        finally:
            self._abandon()

    @abstractmethod
    def close(self) -> None:
        """End all processes, even busy ones."""

    @abstractmethod
    def _dispatch(self, function: Callable[..., Any], tries: Tries) -> None:
        """Give jobs to free workers."""

    @abstractmethod
    def _is_busy(self, tries: Tries) -> bool:
        """Return whether any job is running or waiting for a worker."""

    @abstractmethod
    def _collect(self, tries: Tries) -> list[Outcome[Any]]:
        """Wait for a message and return the outcomes of finished jobs. After a timeout the list is empty."""

    @abstractmethod
    def _abandon(self) -> None:
        """End the busy processes."""


def received(message: bytes, index: int, number: int) -> Outcome[Any] | Failure:
    """Convert a worker's message about attempt ``number`` of a job to an outcome or a failure."""
    kind, value, text, cpu_s = pickle.loads(message)
    if kind == "failure":
        return Failure(index, number, value, text)
    return Outcome(index, error=value, cpu_s=cpu_s) if kind == "error" else Outcome(index, value, cpu_s=cpu_s)


def enumerated(arguments: Iterable[tuple[Any, ...]]) -> Iterator[Job]:
    return (Job(index, values) for index, values in enumerate(arguments))


def in_order(outcomes: Iterable[Outcome[Result]]) -> Iterator[Outcome[Result]]:
    """Yield outcomes in the order of their index, from 0."""
    early: dict[int, Outcome[Result]] = {}
    turn = 0
    for outcome in outcomes:
        early[outcome.index] = outcome
        while turn in early:
            yield early.pop(turn)
            turn += 1


def results(outcomes: Iterable[Outcome[Result]], what: str, log: Path | None = None) -> Iterator[tuple[int, Result]]:
    """Yield the index and the result of every successful job, in any order.

    Args:
        outcomes: outcomes of ``Executor.map_unordered``.
        what: name of the jobs for the message.
        log: file with the log of failed attempts.

    Raises:
        WriteError: a job could not write a file. This error is raised at once, because the other jobs would fail, too.
        GenSim2Error: a job has another error. The error with the smallest index is raised, after the last result.
        NotRunError: some jobs could not be run. This error is raised after the last result.
    """
    errors: dict[int, GenSim2Error] = {}
    not_run: dict[int, str] = {}
    for outcome in outcomes:
        if isinstance(outcome.error, WriteError):
            raise outcome.error
        if outcome.error is not None:
            errors[outcome.index] = outcome.error
        elif outcome.failures:
            not_run[outcome.index] = outcome.failures[-1].reason
        else:
            yield outcome.index, outcome.unwrap()
    if errors:
        raise errors[min(errors)]
    if not_run:
        raise NotRunError(what, not_run, log)

"""Interface of executors, which run jobs on any machines, and outcomes of jobs.

A job is a pure function of values: run again, here or elsewhere, it gives the same result. So a job that was lost with
its process is no result and no failure; it is run again. What a function raises on purpose (a ``GenSim2Error``) is its
answer; anything else that it raises is a bug of ours, and counts as not run.
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

Result = TypeVar("Result")

TRIES = 3
"""Number of tries after which a job counts as one that cannot be run."""


class WorkerStartError(GenSim2Error):
    """A worker process ended by itself before it was ready for its first job: none would ever be done."""


@dataclass(frozen=True)
class Job:
    """One call of a function: its arguments, and an index that the caller chose."""

    index: int
    arguments: tuple[Any, ...]


@dataclass(frozen=True)
class Failure:
    """One try that came to nothing.

    Attributes:
        index: of the job.
        number: of the try, from 1.
        reason: one line.
        traceback: of an exception inside the worker.
    """

    index: int
    number: int
    reason: str
    traceback: str | None = None


@dataclass(frozen=True)
class Outcome(Generic[Result]):
    """Outcome of one job: exactly one of a result, an error and failures.

    Attributes:
        index: of the job.
        result: what the function returned.
        error: what it raised on purpose.
        failures: one a try, where the job could not be run.
        cpu_s: seconds of CPU that another process spent on the try that ended it; 0 where it ran in the caller's own.
    """

    index: int
    result: Result | None = None
    error: GenSim2Error | None = None
    failures: tuple[Failure, ...] = ()
    cpu_s: float = 0.0

    def unwrap(self) -> Result:
        """The result.

        Raises:
            GenSim2Error: what the function raised.
            NotRunError: it could not be run.
        """
        if self.error is not None:
            raise self.error
        if self.failures:
            raise NotRunError("job", {self.index: self.failures[-1].reason})
        return self.result  # type: ignore[return-value]


HOPELESS = 3
"""Jobs that could not be run, with none that could, after which the rest is not tried."""


class Tries:
    """The jobs of one call of ``map_unordered``.

    Args:
        jobs: as given there.
        on_failure: is told of each try that came to nothing, also where a later one succeeds.
        ran: jobs of earlier calls could be run.

    Attributes:
        ran: jobs could be run, in this call or before it.
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
        """Return the job that :meth:`next` gives, and leave it there."""
        job = self.next()
        if job is not None:
            self._again.appendleft(job)
        return job

    def next(self) -> Job | None:
        """A job to run now; None where there is none now."""
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
        """Of the job's present try, from 1."""
        return len(self._failures.get(job.index, ())) + 1

    def over(self, job: Job, found: Outcome[Any] | Failure) -> list[Outcome[Any]]:
        """Take what came of a try; the outcomes of jobs that will not be tried again."""
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
        """Yield the jobs that were not handed out; of an iterator that waits for outcomes, those it has now."""
        while (job := self.next()) is not None:
            yield job


class Executor(ABC):
    """Runs jobs somewhere. A context manager: leaving it ends whatever is under way.

    Args:
        on_failure: is told of each try that came to nothing, also where a later one succeeds.
    """

    def __init__(self, on_failure: Callable[[Failure], None] | None) -> None:
        self._on_failure = on_failure
        self._ran = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def map_unordered(self, function: Callable[..., Result], jobs: Iterable[Job | None]) -> Iterator[Outcome[Result]]:
        """Yield the outcome of ``function(*job.arguments)`` for every job, as each is finished.

        A job that is not run is tried ``TRIES`` times, each time in a fresh process, while others go on. A caller that
        stops early loses what was under way.

        Args:
            function: of a module, so that it pickles by name.
            jobs: taken as places become free. None means "none now": the iterator is asked again after the next
                outcome, so what is submitted may depend on what came of earlier jobs. With none under way it is
                the end.

        Raises:
            WorkerStartError: worker processes cannot start at all.
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
        """End the processes, whatever they are doing."""

    @abstractmethod
    def _dispatch(self, function: Callable[..., Any], tries: Tries) -> None:
        """Hand jobs to the places that are free."""

    @abstractmethod
    def _is_busy(self, tries: Tries) -> bool:
        """Whether jobs are under way, or wait for a place."""

    @abstractmethod
    def _collect(self, tries: Tries) -> list[Outcome[Any]]:
        """Wait until a process has something to say, for a while at most, and return the outcomes."""

    @abstractmethod
    def _abandon(self) -> None:
        """End the processes that are busy."""


def received(message: bytes, index: int, number: int) -> Outcome[Any] | Failure:
    """Return what a worker's answer says of try ``number`` of a job."""
    kind, value, text, cpu_s = pickle.loads(message)
    if kind == "failure":
        return Failure(index, number, value, text)
    return Outcome(index, error=value, cpu_s=cpu_s) if kind == "error" else Outcome(index, value, cpu_s=cpu_s)


def enumerated(arguments: Iterable[tuple[Any, ...]]) -> Iterator[Job]:
    """Jobs numbered from 0."""
    return (Job(index, values) for index, values in enumerate(arguments))


def in_order(outcomes: Iterable[Outcome[Result]]) -> Iterator[Outcome[Result]]:
    """Outcomes by their index, from 0 on: each is held back until those before it are there."""
    early: dict[int, Outcome[Result]] = {}
    turn = 0
    for outcome in outcomes:
        early[outcome.index] = outcome
        while turn in early:
            yield early.pop(turn)
            turn += 1


def results(outcomes: Iterable[Outcome[Result]], what: str, log: Path | None = None) -> Iterator[tuple[int, Result]]:
    """Yield (index, result) of every job that was run, as they come; say only then which were not.

    Args:
        outcomes: of ``Executor.map_unordered``.
        what: the jobs are, for the message.
        log: where the tries that came to nothing are written down.

    Raises:
        WriteError: a job could not write what it found, at once: the others would run for nothing.
        GenSim2Error: what else the job with the smallest index raised on purpose, after the last result.
        NotRunError: some jobs could not be run, after the last result.
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

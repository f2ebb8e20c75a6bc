"""Interface of executors, which run jobs on any machines, and outcomes of jobs.

A job is a pure function of values: run again, here or elsewhere, it gives the same result. So a job that was lost with
its process is no result and no failure; it is run again. What a function raises on purpose (a ``GenSim2Error``) is its
answer; anything else that it raises is a bug of ours, and counts as not run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from gensim2.core.errors import GenSim2Error, NotRunError, WriteError

Result = TypeVar("Result")

TRIES = 3
"""Number of tries after which a job counts as one that cannot be run."""


class WorkerStartError(GenSim2Error):
    """A worker process ended by itself before it was ready for its first job: none would ever be done."""


@dataclass(frozen=True)
class Job:
    """Arguments of one call, and the number by which the caller knows it."""

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


class Executor(Protocol):
    """Runs jobs somewhere. A context manager: leaving it ends whatever is under way."""

    def map_unordered(self, function: Callable[..., Result], jobs: Iterable[Job | None]) -> Iterator[Outcome[Result]]:
        """Yield the outcome of ``function(*job.arguments)`` for every job, as each is finished.

        A job that is not run is tried ``TRIES`` times, each time in a fresh process, while others go on.

        Args:
            function: of a module, so that it pickles by name.
            jobs: taken as places become free. None means "none now": the iterator is asked again after the next
                outcome, so what is submitted may depend on what came of earlier jobs. With none under way it is
                the end.
        """
        ...

    def __enter__(self) -> Executor: ...

    def __exit__(self, *_: object) -> None: ...

    def close(self) -> None:
        """End the processes, whatever they are doing."""
        ...


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

"""Jobs to hand out: new ones, and those whose try came to nothing; the same wherever they run."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from gensim2.core.processes.executor import TRIES, Failure, Job, Outcome

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

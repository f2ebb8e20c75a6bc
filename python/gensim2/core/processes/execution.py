"""Define settings for running jobs: number of workers, time limit, Ray cluster."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, TypedDict

from gensim2.core.errors import InputError, brief
from gensim2.core.processes.executor import Executor, Failure
from gensim2.core.processes.fork_server import end_unguarded_worker
from gensim2.core.processes.pool import JOBS_PER_WORKER, TIME_LIMIT, WorkerPool

LONGEST_TIME_LIMIT = 1e6
"""Largest time limit, s (eleven days); infinity is not a valid timeout."""


class ExecutionArguments(TypedDict, total=False):
    """Options of commands that run jobs in worker processes. The results do not depend on these options.

    Keys:
        workers: number of processes; 0 runs the jobs in this process. With Ray, this is the maximum number of
            simultaneous processes, and None means one process for each CPU of the cluster. The default is 2.
        ray: ``"local"``, or the address of a Ray cluster whose nodes all have the output folder at the same path. None
            runs the jobs without Ray, in processes of this machine. The default is None.
        time_limit: seconds after which a job counts as hung and runs again in a fresh process. The default is 900.
        jobs_per_worker: number of jobs after which a process is replaced. The default is 500.
    """

    workers: int | None
    ray: str | None
    time_limit: float
    jobs_per_worker: int


@dataclass(frozen=True)
class Execution:
    """Checked settings for running jobs.

    Attributes:
        workers, ray, time_limit, jobs_per_worker: see :class:`ExecutionArguments`.

    Raises:
        InputError: a value is out of range, or ``ray`` is not an address.
        MissingExtraError: ``ray`` is given and Ray is not installed.
    """

    workers: int | None = 2
    ray: str | None = None
    time_limit: float = TIME_LIMIT
    jobs_per_worker: int = JOBS_PER_WORKER

    def __post_init__(self) -> None:
        end_unguarded_worker()  # before the caller uses its output folder, which the parent process has locked
        if self.ray is not None:
            from gensim2.core.processes.ray import check_address

            check_address(self.ray)
        if self.workers is None and self.ray is None:
            raise InputError("must be a number; None is allowed only for a run on a Ray cluster", field="workers")
        if self.workers is not None and self.workers < 0:
            raise InputError(f"must be at least 0, not {brief(self.workers)}", field="workers")
        if self.workers == 0 and self.ray is not None:
            raise InputError("must be at least 1 for a run on Ray", field="workers")
        if not 0 < self.time_limit <= LONGEST_TIME_LIMIT:
            raise InputError(f"must lie in 0..{LONGEST_TIME_LIMIT:g} s, but is {self.time_limit}", field="time_limit")
        if self.jobs_per_worker < 1:
            raise InputError(f"must be at least 1, not {brief(self.jobs_per_worker)}", field="jobs_per_worker")

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Execution:
        """Return the settings among the keyword arguments ``given``. Other keyword arguments are ignored."""
        return cls(**{each.name: given[each.name] for each in fields(cls) if each.name in given})

    def at_most(self, jobs: int) -> Execution:
        """Return a copy of the settings with at most ``jobs`` local worker processes."""
        if self.ray is not None or self.workers is None:
            return self
        return replace(self, workers=min(self.workers, jobs))

    def to_record(self) -> dict[str, Any]:
        return {"workers": self.workers, "ray": self.ray}

    def executor(
        self,
        *,
        preload: Sequence[str] = (),
        prepare: Callable[[], object] | None = None,
        on_failure: Callable[[Failure], None] | None = None,
    ) -> Executor:
        """Return a new executor; the arguments are those of :class:`~gensim2.core.processes.WorkerPool`."""
        how: dict[str, Any] = {"time_limit": self.time_limit, "jobs_per_worker": self.jobs_per_worker}
        how |= {"preload": preload, "prepare": prepare, "on_failure": on_failure}
        if self.ray is not None:
            from gensim2.core.processes.ray import RayPool

            return RayPool(self.ray, self.workers, **how)
        assert self.workers is not None
        return WorkerPool(self.workers, **how)

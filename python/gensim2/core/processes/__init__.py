"""Jobs in other processes: run again where a process was lost, finished in any order, never in doubt."""

from gensim2.core.processes.executor import (
    Executor,
    Failure,
    Job,
    Outcome,
    WorkerStartError,
    enumerated,
    in_order,
    results,
)
from gensim2.core.processes.place import executor_at
from gensim2.core.processes.pool import JOBS_PER_WORKER, TIME_LIMIT, WorkerPool

__all__ = [
    "JOBS_PER_WORKER",
    "TIME_LIMIT",
    "Executor",
    "Failure",
    "Job",
    "Outcome",
    "WorkerPool",
    "WorkerStartError",
    "enumerated",
    "executor_at",
    "in_order",
    "results",
]

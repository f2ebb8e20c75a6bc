"""Run jobs in worker processes; a job whose process dies runs again, and jobs may finish in any order."""

from gensim2.core.processes.execution import Execution, ExecutionArguments
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
from gensim2.core.processes.pool import WorkerPool

__all__ = [
    "Execution",
    "ExecutionArguments",
    "Executor",
    "Failure",
    "Job",
    "Outcome",
    "WorkerPool",
    "WorkerStartError",
    "enumerated",
    "in_order",
    "results",
]

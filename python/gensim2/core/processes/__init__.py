"""Jobs in other processes: run again where a process was lost, finished in any order, never in doubt."""

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

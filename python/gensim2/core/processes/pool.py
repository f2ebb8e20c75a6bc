"""Run jobs in worker processes on this machine; the processes share no memory.

SAPIEN runs one environment per process on the CPU, so each simulator needs its own process. Workers are forked from a
server that has imported all modules but has run no job. A forked worker takes 0.1 s instead of the 8 s of a spawned
worker, and has no copy of the parent's state.
"""

from __future__ import annotations

import contextlib
import gc
import multiprocessing
import os
import pickle
import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, TypeVar

from gensim2.core.errors import GenSim2Error
from gensim2.core.processes.executor import TRIES, Executor, Failure, Job, Outcome, Tries, WorkerStartError, received
from gensim2.core.processes.fork_server import (
    WORKER,
    end_unguarded_worker,
    end_with_the_parent,
    ignore_interrupts,
    start_fork_server,
)

_CONTEXT = multiprocessing.get_context("forkserver")

SINGLE_THREADED = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS"), "1"
)
"""Environment variables that limit libraries to one thread, because processes already use all cores."""

SERVER_LOST = 255
"""Exit code of a process whose fork server was killed before it reported the real exit code."""

START_LIMIT = 300.0
"""Time in which a worker must be ready for its first job, s."""


class Worker:
    """One worker process and its current job; the process is started for the first job."""

    def __init__(self, time_limit: float, jobs: int, prepare: Callable[[], object] | None = None) -> None:
        self._time_limit, self._jobs, self._prepare = time_limit, jobs, prepare
        self._process: BaseProcess | None = None
        self._connection: Connection | None = None
        self._job: Job | None = None
        self._ready = False
        self._served = 0
        self._since = 0.0

    @property
    def job(self) -> Job | None:
        return self._job

    @property
    def connection(self) -> Connection:
        """Connection that becomes readable when the process has sent its answer, or has ended."""
        assert self._connection is not None
        return self._connection

    @property
    def deadline(self) -> float:
        """Time of the clock ``time.monotonic`` at which the current job counts as hung."""
        return self._since + (self._time_limit if self._ready else START_LIMIT)

    def send(self, job: Job, function: Callable[..., Any], *, fresh: bool) -> None:
        """Start a job; ``fresh`` starts a new process for the job."""
        payload = pickle.dumps((function, job.arguments))  # pickling errors appear in the caller, not in a worker
        if fresh or self._served >= self._jobs or self._process is None or not self._process.is_alive():
            self.stop()
            self._start()
        self._job, self._since = job, time.monotonic()
        # If the worker has just died, sending fails, and ``receive`` reports the failed attempt.
        with contextlib.suppress(OSError):
            self.connection.send_bytes(payload)

    def receive(self, number: int) -> Outcome[Any] | Failure | None:
        """Return the outcome of attempt ``number``.

        Return None for the first message of a worker, which says that it is ready.

        Raises:
            WorkerStartError: the process ended before its first job.
        """
        assert self._job is not None
        try:
            message = self.connection.recv_bytes()
        except (EOFError, OSError):
            return self._dead(number)
        if not self._ready:
            self._ready, self._since = True, time.monotonic()
            return None
        found = received(message, self._job.index, number)
        if isinstance(found, Failure):
            self.stop()
        self._job, self._served = None, self._served + 1
        return found

    def give_up(self, number: int, reason: str | None = None) -> Failure:
        """Kill the process and return the failure of attempt ``number``; the default reason is a timeout."""
        assert self._job is not None
        index = self._job.index
        too_long = f"took longer than {self._time_limit:g} s" if self._ready else f"did not start in {START_LIMIT:g} s"
        self.stop()
        return Failure(index, number, reason or too_long)

    def stop(self) -> None:
        self._job, self._ready, self._served = None, False, 0
        if self._connection is not None:
            self._connection.close()
            self._connection = None
        if self._process is not None:
            self._process.terminate()
            self._process.join(timeout=5)
            if self._process.is_alive():
                self._process.kill()
                self._process.join()
            self._process = None

    def _dead(self, number: int) -> Failure:
        process = self._process
        assert process is not None
        process.join(timeout=5)
        fate = _fate(process.exitcode)
        killed = process.exitcode is None or process.exitcode < 0 or process.exitcode == SERVER_LOST
        if not self._ready and not killed:
            self.stop()
            raise WorkerStartError(
                f"a worker process ended before its first job ({fate}). Each worker imports the main script, "
                'so the script must start its workers below `if __name__ == "__main__":`'
            ) from None
        return self.give_up(number, f"the worker process died ({fate})")

    def _start(self) -> None:
        environment = {**os.environ, **SINGLE_THREADED}
        with _single_threaded():
            self._process, self._connection = start_process(_serve, (environment, self._prepare))


def start_process(
    target: Callable[..., None], arguments: tuple[Any, ...], *, duplex: bool = True
) -> tuple[BaseProcess, Connection]:
    """Start a worker process.

    Return the process and the parent's end of a connection that closes when the process ends.

    Args:
        target: function that the process runs, called with the process's end of the connection and ``arguments``.
        duplex: whether the parent can also send messages to the process.

    Raises:
        WorkerStartError: the process cannot be started.
    """
    end_unguarded_worker()
    for number in range(TRIES):
        ours, theirs = _CONTEXT.Pipe(duplex)
        process = _CONTEXT.Process(target=target, args=(theirs, *arguments), name=WORKER, daemon=True)
        try:
            start_fork_server()
            process.start()
            return process, ours
        except (OSError, EOFError) as error:  # the fork server was killed; the next attempt starts a new fork server
            ours.close()
            if number == TRIES - 1:
                raise WorkerStartError(f"worker processes cannot be started: {error}") from error
            time.sleep(0.2)
        except BaseException:
            ours.close()
            raise
        finally:
            # Close the worker's end here, so that the connection ends when the worker dies.
            theirs.close()
    raise AssertionError("this line is unreachable, because the last attempt returns or raises")


def preload_modules(modules: Sequence[str]) -> None:
    """Let the fork server import modules once, so that workers start with the modules loaded.

    Call this before the first worker starts, because the fork server starts together with this worker. Later calls have
    no effect. Modules that cannot be imported are skipped: the jobs that need them report the error.
    """
    _CONTEXT.set_forkserver_preload(list(modules))


@contextlib.contextmanager
def _single_threaded() -> Iterator[None]:
    """Limit processes that start in this block to one thread.

    Libraries read the limit from variables when they are imported.
    """
    before = {name: os.environ.get(name) for name in SINGLE_THREADED}
    os.environ.update(SINGLE_THREADED)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _fate(exitcode: int | None) -> str:
    if exitcode is None:
        return "no exit code"
    if exitcode >= 0:
        return f"exit code {exitcode}"
    try:
        return signal.Signals(-exitcode).name
    except ValueError:
        return f"signal {-exitcode}"


def _serve(connection: Connection, environment: Mapping[str, str], prepare: Callable[[], object] | None = None) -> None:
    """Receive jobs and run them until the parent closes the connection. Every worker process runs this function."""
    ignore_interrupts()  # Ctrl-C reaches the whole process group; the parent handles it
    os.environ.clear()
    os.environ.update(environment)  # the fork server may have older values of the variables
    threading.Thread(target=end_with_the_parent, daemon=True).start()
    if prepare is not None:
        # A failing import is ignored here: the job imports the module again and reports the error.
        with contextlib.suppress(Exception):
            prepare()
    gc.freeze()  # exclude imported objects from garbage collection, which saves 7 % of the run time
    with contextlib.suppress(OSError):  # if the parent has ended, sending fails, and the loop below returns
        connection.send_bytes(b"ready")
    while True:
        try:
            payload = connection.recv_bytes()
        except (EOFError, OSError):
            return
        said = answer(payload)
        try:
            connection.send_bytes(said)
        except OSError:
            return


def answer(payload: bytes) -> bytes:
    """Run a pickled call (function, arguments) in this process and return its pickled outcome.

    Returns:
        Pickled (kind, value, traceback, CPU time in s); kind is ``"result"``, ``"error"`` or ``"failure"``.
    """
    try:
        function, arguments = pickle.loads(payload)
        begin = time.process_time()
        try:
            result = function(*arguments)
            return pickle.dumps(("result", result, None, time.process_time() - begin))
        except GenSim2Error as error:
            said = pickle.dumps(("error", error, None, time.process_time() - begin))
            pickle.loads(said)  # check that the parent can unpickle the error; otherwise report a failure below
            return said
    except BaseException as error:  # noqa: BLE001 - panics of the solver and exits are failures too
        words = " ".join(f"{type(error).__name__}: {error}".split())
        return pickle.dumps(("failure", words, traceback.format_exc(), 0.0))


Result = TypeVar("Result")

TIME_LIMIT = 900.0
"""Default time after which a job counts as hung, s."""

JOBS_PER_WORKER = 500
"""Default number of jobs after which a worker process is replaced, because libraries leak memory."""


class WorkerPool(Executor):
    """A fixed number of worker processes.

    Ctrl-C in the parent ends the workers at once and leaves the block. Outcomes that were already yielded are complete.

    Args:
        workers: number of processes. 0 runs jobs in this process and raises unexpected exceptions unchanged.
        time_limit: time after which a job counts as hung and its worker is replaced, s.
        jobs_per_worker: number of jobs after which a process is replaced.
        preload: slow modules, which are imported once for all workers. Only the first pool of a process uses this
            argument.
        prepare: function called in each process before its first job; must be picklable.
        on_failure: callback for each failed attempt, even if a later one succeeds.
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
            raise ValueError(f"the number of workers must be at least 0, but is {workers}")
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
            if job is None:  # no job is running, so the outcome for which the next job waits will never come
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
        # The connection of a dead worker becomes readable, so waiting on connections detects crashes as well.
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

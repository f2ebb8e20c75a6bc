"""Worker processes that share nothing: jobs go out, results come back in the order of the jobs.

Each simulator wants a process of its own: SAPIEN runs one environment a process on the CPU. Workers are
spawned, not forked, so that they begin with a clean PhysX and a clean torch.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, Generic, TypeVar

from gensim2.errors import GenSim2Error

Result = TypeVar("Result")

_CONTEXT = multiprocessing.get_context("spawn")

_SINGLE_THREADED = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS")
"""The processes are the parallelism; threads inside them would only compete."""


class JobError(GenSim2Error):
    """A job that did not end: its worker died, or it took too long. Other jobs are not affected."""


class WorkerStartError(GenSim2Error):
    """A worker process ended before it was ready for its first job: none would ever be done."""


@dataclass(frozen=True)
class Outcome(Generic[Result]):
    """What came of one job.

    Attributes:
        index: of the job in the sequence that was given.
        result: what the function returned; None where it raised.
        error: what it raised, or a :class:`JobError`; None where it returned.
        traceback: of the error inside the worker, as text.
    """

    index: int
    result: Result | None
    error: Exception | None = None
    traceback: str | None = None

    def unwrap(self) -> Result:
        """The result; raises the error if there is one."""
        if self.error is not None:
            raise self.error
        return self.result  # type: ignore[return-value]


class WorkerPool:
    """A fixed number of worker processes; use it as a context manager.

    Ctrl-C in the parent ends the workers at once and leaves the ``with`` block; whatever was yielded before
    is whole.

    Args:
        workers: number of processes; 0 runs the jobs in this process, which helps when debugging.
        timeout: seconds after which a job counts as hung and its worker is replaced.
    """

    def __init__(self, workers: int, *, timeout: float = 900.0) -> None:
        if workers < 0:
            raise ValueError(f"workers must not be negative, is {workers}")
        self._timeout = timeout
        self._workers = [_Worker() for _ in range(workers)]

    def __enter__(self) -> WorkerPool:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the workers, whatever they are doing."""
        for worker in self._workers:
            worker.stop()

    def map(self, function: Callable[..., Result], jobs: Iterable[tuple[Any, ...]]) -> Iterator[Outcome[Result]]:
        """Yield the outcome of ``function(*job)`` for every job, in order, whatever the number of workers.

        Jobs are taken from the iterable as workers become free, at most two a worker ahead of what was
        yielded: a caller may stop early, and loses nothing but what was under way.

        Args:
            function: of a module, so that it pickles by name.
            jobs: argument tuples that pickle.

        Raises:
            WorkerStartError: where worker processes cannot start at all.
        """
        if not self._workers:
            yield from (_run_here(index, function, job) for index, job in enumerate(jobs))
            return
        source = enumerate(jobs)
        done: dict[int, Outcome[Result]] = {}
        turn, exhausted = 0, False
        try:
            while True:
                for worker in self._workers:
                    if worker.busy or exhausted or len(done) >= len(self._workers):
                        continue
                    entry = next(source, None)
                    if entry is None:
                        exhausted = True
                    else:
                        worker.send(entry[0], function, entry[1])
                while turn in done:
                    yield done.pop(turn)
                    turn += 1
                if any(worker.busy for worker in self._workers):
                    done.update((outcome.index, outcome) for outcome in self._collect())
                elif exhausted and not done:
                    return
        finally:
            for worker in self._workers:
                worker.unwanted = worker.busy  # the caller stopped early: drop the result when it comes

    def _collect(self) -> list[Outcome[Any]]:
        """Wait until at least one busy worker has something to say, and return the outcomes."""
        busy = [worker for worker in self._workers if worker.busy]
        patience = min(worker.started for worker in busy) + self._timeout - time.monotonic()
        # A dead worker's connection reads as ended, so waiting on connections covers crashes as well.
        ready = wait([worker.connection for worker in busy], timeout=max(patience, 0.0))
        outcomes = []
        for worker in busy:
            unwanted = worker.unwanted
            if worker.connection in ready:
                received = worker.receive()
                if received is None:
                    continue
                outcome = received
            elif time.monotonic() - worker.started >= self._timeout:
                outcome = worker.give_up(f"took longer than {self._timeout:.0f} s")
            else:
                continue
            if not unwanted:
                outcomes.append(outcome)
        return outcomes


class _Worker:
    """One process and the job that it is busy with; the process starts with its first job."""

    def __init__(self) -> None:
        self._process: BaseProcess | None = None
        self._connection: Connection | None = None
        self._job: int | None = None
        self._ready = False
        self.started = 0.0
        self.unwanted = False

    @property
    def busy(self) -> bool:
        return self._job is not None

    @property
    def connection(self) -> Connection:
        assert self._connection is not None
        return self._connection

    def send(self, index: int, function: Callable[..., Any], job: tuple[Any, ...]) -> None:
        payload = pickle.dumps((function, job))  # fails here, in the caller's face, not in a worker
        if self._process is None or not self._process.is_alive():
            self.stop()
            self._start()
        self._job, self.started, self.unwanted = index, time.monotonic(), False
        try:
            self.connection.send_bytes(payload)
        except OSError:
            return  # the worker died just now: its connection reads as ended, which is this job's outcome

    def receive(self) -> Outcome[Any] | None:
        """The outcome of the job; None where the worker only says that it is ready for it."""
        index = self._job
        assert index is not None
        try:
            message = self.connection.recv_bytes()
        except (EOFError, OSError):
            process = self._process
            assert process is not None
            process.join(timeout=5)
            fate = _fate(process.exitcode)
            if not self._ready:
                self.stop()
                raise WorkerStartError(
                    f"a worker process ended before its first job ({fate}). A script that starts workers must do so "
                    'below `if __name__ == "__main__":`, because each worker imports it'
                ) from None
            return self.give_up(f"the worker process died ({fate})")
        if not self._ready:
            self._ready = True
            return None
        result, error, text = pickle.loads(message)
        self._job = None
        return Outcome(index, result, error, text)

    def give_up(self, reason: str) -> Outcome[Any]:
        index = self._job
        assert index is not None
        self.stop()
        return Outcome(index, None, JobError(f"job {index}: {reason}"))

    def stop(self) -> None:
        self._job = None
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

    def _start(self) -> None:
        ours, theirs = _CONTEXT.Pipe()
        self._ready = False
        process = _CONTEXT.Process(target=_serve, args=(theirs,), daemon=True)
        process.start()
        theirs.close()  # so that the worker's death ends the connection
        self._process, self._connection = process, ours


def _fate(exitcode: int | None) -> str:
    if exitcode is None:
        return "no exit code"
    if exitcode >= 0:
        return f"exit code {exitcode}"
    try:
        return signal.Signals(-exitcode).name
    except ValueError:
        return f"signal {-exitcode}"


def _run_here(index: int, function: Callable[..., Result], job: tuple[Any, ...]) -> Outcome[Result]:
    try:
        return Outcome(index, function(*job))
    except Exception as error:  # noqa: BLE001 - whatever a job raises is its outcome
        return Outcome(index, None, error, traceback.format_exc())


def _serve(connection: Connection) -> None:
    """Body of a worker process: jobs in, outcomes out, until the parent closes the connection."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent decides
    for name in _SINGLE_THREADED:
        os.environ[name] = "1"
    threading.Thread(target=_end_with_the_parent, daemon=True).start()
    with contextlib.suppress(OSError):  # a parent that is gone already shows below
        connection.send_bytes(b"ready")
    while True:
        try:
            payload = connection.recv_bytes()
        except (EOFError, OSError):
            return
        outcome = _answer(payload)
        try:
            connection.send_bytes(outcome)
        except OSError:
            return


def _end_with_the_parent() -> None:
    """End this process when the parent is gone, be it killed: a long job would otherwise run on for nobody."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _answer(payload: bytes) -> bytes:
    try:
        function, job = pickle.loads(payload)
        return pickle.dumps((function(*job), None, None))
    except Exception as error:  # noqa: BLE001 - whatever a job raises is its outcome
        text = traceback.format_exc()
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:  # noqa: BLE001 - an exception that does not survive pickling goes as text
            error = JobError(f"{type(error).__name__}: {error}")
        return pickle.dumps((None, error, text))

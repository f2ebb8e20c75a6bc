"""Run jobs on a Ray cluster whose nodes may come and go.

Each actor is a process that runs one job at a time, and only when it is ready. New nodes of the cluster get new actors.
"""

from __future__ import annotations

import atexit
import contextlib
import importlib
import importlib.util
import logging
import os
import pickle
import re
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, TypeVar

from gensim2.core.cores import usable_cores
from gensim2.core.errors import InputError, MissingExtraError, NotRunError
from gensim2.core.processes.executor import TRIES, Executor, Failure, Job, Outcome, Tries, WorkerStartError, received
from gensim2.core.processes.pool import JOBS_PER_WORKER, SINGLE_THREADED, START_LIMIT, TIME_LIMIT, answer

Result = TypeVar("Result")

GONE_SECONDS = 15.0
"""Time (s) without an answer after which the head counts as lost. Ray itself waits 60 s."""

RETRY_SECONDS = 1.0
"""Time (s) between attempts to reach a missing head, and longest time between two checks of the time limits."""

left_waiting = False
"""Whether this process left Ray while Ray waited for a lost head. Ray's threads would then change the exit code."""

_ADDRESS = re.compile(r"local|auto|[\w.-]+:\d{1,5}|\[[0-9a-fA-F:]+\]:\d{1,5}")


def check_address(address: str) -> None:
    """Check the format of a Ray address, without starting anything.

    Raises:
        InputError: the address is not ``"local"``, ``"auto"`` or ``HOST:PORT``.
        MissingExtraError: Ray is not installed.
    """
    if not _ADDRESS.fullmatch(address):
        wrong = f"{address!r} is not a Ray address"
        raise InputError(wrong, field="--ray", remedy="local, auto, or HOST:PORT of the head node")
    if importlib.util.find_spec("ray") is None:
        raise MissingExtraError("ray", "ray")


class _Environment:
    """Ray actor that imports modules, prepares its environment, and runs jobs."""

    def __init__(self, path: Sequence[str], modules: Sequence[str], prepare: bytes) -> None:
        # A pickled job contains only the module and name of its function, so this process must find the same modules.
        sys.path.extend(folder for folder in path if folder not in sys.path)
        for name in modules:
            with contextlib.suppress(ImportError):  # importing fails again in the jobs, which report the error
                importlib.import_module(name)
        with contextlib.suppress(Exception):  # An error is ignored here, because the job will fail with the same error.
            function = pickle.loads(prepare)
            if function is not None:
                function()

    def ready(self) -> None:
        """Do nothing. Ray answers a call of this method only after ``__init__`` has prepared the environment."""

    def run(self, payload: bytes) -> bytes:
        return answer(payload)


class Head:
    """Monitor of the head node of a Ray cluster. The monitor has a connection that ends when the node fails.

    Ray itself would block requests for a minute after the loss, and then end this process with code 1.

    Args:
        address: ``HOST:PORT`` of the control service on the head node.

    Attributes:
        is_there: whether the connection is open.
        is_gone: whether the head node has accepted no connection for ``GONE_SECONDS``.
    """

    def __init__(self, address: str) -> None:
        host, _, port = address.rpartition(":")
        self.address = address
        self._where = (host.strip("[]"), int(port))
        self.is_there, self.is_gone = True, False
        threading.Thread(target=self._watch, daemon=True).start()

    def _watch(self) -> None:
        answered = time.monotonic()
        while not self.is_gone:
            try:
                with socket.create_connection(self._where, GONE_SECONDS) as connection:
                    self.is_there = True
                    _keep_alive(connection)
                    connection.settimeout(None)
                    connection.recv(1)  # recv returns when the head closes the connection or dies
                answered = time.monotonic()
            except OSError:
                answered = time.monotonic() if self.is_there else answered
                self.is_there = False
                self.is_gone = time.monotonic() - answered > GONE_SECONDS
            time.sleep(RETRY_SECONDS)


def _keep_alive(connection: socket.socket) -> None:
    """Let the kernel close the connection if the other machine no longer answers."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in (("TCP_KEEPIDLE", 5), ("TCP_KEEPINTVL", 5), ("TCP_KEEPCNT", 2)):
        if hasattr(socket, name):
            connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


class _Place:
    """One Ray actor and its current job."""

    def __init__(self, actor: Any) -> None:
        self.actor = actor
        self.awaited = actor.ready.remote()
        self.is_ready = False
        self.job: Job | None = None
        self.since = time.monotonic()
        self.served = 0

    def send(self, job: Job, payload: bytes) -> None:
        self.job, self.since = job, time.monotonic()
        self.awaited = self.actor.run.remote(payload)


class RayPool(Executor):
    """Executor that runs jobs on a Ray cluster.

    Each job runs in an actor, which is a worker process of Ray. If there are fewer than ``workers`` actors, one request
    for another actor is always open. Therefore the pool grows when a node joins the cluster.

    Args:
        address: ``"local"`` for a new cluster on this machine, ``"auto"`` or ``HOST:PORT`` for an existing one.
        workers: maximum number of actors. None: the current number of CPUs of the cluster.
        time_limit, jobs_per_worker, preload, prepare, on_failure: as for :class:`~gensim2.core.processes.WorkerPool`.

    Raises:
        InputError: no cluster answers at the address, or the cluster has another version of Ray or Python.
        MissingExtraError: Ray is not installed.
    """

    def __init__(
        self,
        address: str,
        workers: int | None,
        *,
        time_limit: float = TIME_LIMIT,
        jobs_per_worker: int = JOBS_PER_WORKER,
        preload: Sequence[str] = (),
        prepare: Callable[[], object] | None = None,
        on_failure: Callable[[Failure], None] | None = None,
    ) -> None:
        super().__init__(on_failure)
        check_address(address)
        import ray

        self._ray = ray
        self._time_limit, self._jobs_per_worker = time_limit, jobs_per_worker
        self._arguments = (tuple(sys.path), tuple(preload), pickle.dumps(prepare))
        self._places: list[_Place] = []
        self._failed_starts, self._alive = 0, time.monotonic()
        _connect(ray, address, workers)
        self._head = Head(ray.get_runtime_context().gcs_address)
        there = int(ray.cluster_resources().get("CPU", 0))
        self._most = workers or (there if address == "local" else sys.maxsize)
        self._first = max(1, min(there, self._most))
        self._remote = ray.remote(num_cpus=1, max_restarts=0)(_Environment)

    def close(self) -> None:
        """End all actors, even busy ones, and leave the cluster."""
        global left_waiting
        for place in list(self._places):
            self._end(place)
        if self._head.is_gone:  # without a head node, ray.shutdown would wait and then end this process
            atexit.unregister(self._ray.shutdown)
            left_waiting = True
        else:
            self._ray.shutdown()

    def map_unordered(self, function: Callable[..., Result], jobs: Iterable[Job | None]) -> Iterator[Outcome[Result]]:
        self._alive = time.monotonic()
        return super().map_unordered(function, jobs)

    def _dispatch(self, function: Callable[..., Any], tries: Tries) -> None:
        while self._head.is_there and (job := tries.peek()) is not None:
            idle = next((place for place in self._places if place.is_ready and place.job is None), None)
            if idle is None:
                self._grow()
                return
            idle.send(job, pickle.dumps((function, job.arguments)))
            tries.next()

    def _is_busy(self, tries: Tries) -> bool:
        return tries.peek() is not None or any(place.job for place in self._places)

    def _abandon(self) -> None:
        for place in list(self._places):
            if place.job is not None:
                self._end(place)

    def _grow(self) -> None:
        """Request an actor for each CPU. When all actors are ready, request one more, because the cluster may grow."""
        waits = any(not place.is_ready for place in self._places)
        wanted = max(self._first, len(self._places) + (not waits))
        while len(self._places) < min(wanted, self._most):
            self._places.append(_Place(self._remote.remote(*self._arguments)))
        if any(place.is_ready for place in self._places):
            self._alive = time.monotonic()
        elif time.monotonic() - self._alive > START_LIMIT:
            raise WorkerStartError(f"no actor of the Ray cluster was ready in {START_LIMIT:g} s")

    def _collect(self, tries: Tries) -> list[Outcome[Any]]:
        waiting = tries.peek()
        if self._head.is_gone:
            jobs = [job for job in (waiting, *(place.job for place in self._places)) if job is not None]
            reason = f"the head of the cluster, {self._head.address}, does not answer"
            raise NotRunError("jobs on Ray", {job.index: reason for job in jobs})
        awaited = {place.awaited: place for place in self._places if place.job is not None or not place.is_ready}
        if not awaited:
            # No actor can answer now. Wait before the next attempt, because the head node may return.
            time.sleep(RETRY_SECONDS)
            return []
        done, _ = self._ray.wait(list(awaited), num_returns=1, timeout=RETRY_SECONDS, fetch_local=True)
        outcomes: list[Outcome[Any]] = []
        for reference in done:
            place = awaited[reference]
            if place.job is None:
                self._started(place)
            else:
                outcomes.extend(tries.over(place.job, self._received(place, place.job, tries.number(place.job))))
        for place in awaited.values():
            if (job := place.job) is not None and time.monotonic() > place.since + self._time_limit:
                self._end(place)
                found = Failure(job.index, tries.number(job), f"took longer than {self._time_limit:g} s")
                outcomes.extend(tries.over(job, found))
        return outcomes

    def _started(self, place: _Place) -> None:
        try:
            self._ray.get(place.awaited)
            place.is_ready, self._failed_starts = True, 0
        except self._ray.exceptions.RayError as error:
            self._end(place)
            self._failed_starts += 1
            if self._failed_starts >= TRIES * self._first:
                words = " ".join(str(error).split())
                died = "the workers on the Ray cluster (Ray actors) died before their first job"
                raise WorkerStartError(f"{died}: {words}") from error

    def _received(self, place: _Place, job: Job, number: int) -> Outcome[Any] | Failure:
        """Return the outcome or failure of an actor. End the actor after a failure and after its last permitted job."""
        try:
            found = received(self._ray.get(place.awaited), job.index, number)
        except self._ray.exceptions.RayError as error:
            found = Failure(job.index, number, f"the worker process died ({type(error).__name__})")
        place.job, place.served = None, place.served + 1
        if isinstance(found, Failure) or place.served >= self._jobs_per_worker:
            self._end(place)
        return found

    def _end(self, place: _Place) -> None:
        if place in self._places:
            self._places.remove(place)
        place.job = None
        if self._head.is_there:
            with contextlib.suppress(Exception):  # the actor or its node may have ended
                self._ray.kill(place.actor)


def _connect(ray: Any, address: str, workers: int | None) -> None:
    """Join or start a cluster without changing the handlers of Ctrl-C and SIGTERM. Raise InputError if impossible."""
    where: dict[str, Any] = {"address": address}
    if address == "local":  # without the address "local" Ray looks for a running cluster
        where |= {"num_cpus": workers or usable_cores(), "include_dashboard": False}
        # with Ray's default niceness, 15, workers get too little CPU time on a busy machine
        where["_system_config"] = {"worker_niceness": 0}
    handlers = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        for number in range(TRIES):
            try:
                ray.init(
                    **where, logging_level=logging.ERROR, log_to_driver=False, runtime_env={"env_vars": _environment()}
                )
                return
            # Ray also raises a plain ``Exception``, for example after 15 s without a local node (its issue 65983).
            except Exception as error:
                ray.shutdown()
                if address != "local" or number == TRIES - 1:
                    words = " ".join(str(error).split())
                    raise InputError(f"the Ray cluster cannot be used: {words}", field="--ray") from error
    finally:
        # Only the main thread can set signal handlers; in another thread, Python raises a ValueError.
        with contextlib.suppress(ValueError):
            for number, handler in handlers.items():
                signal.signal(number, handler)


def _environment() -> dict[str, str]:
    """Return the environment variables that may affect the result of a job or limit libraries to one thread."""
    return {**{name: value for name, value in os.environ.items() if name.startswith("GENSIM2_")}, **SINGLE_THREADED}

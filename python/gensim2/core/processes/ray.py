"""Jobs on a Ray cluster: the same outcomes as on this machine, on as many nodes as there are at the moment.

One actor is one process for one environment. A job goes to an actor only once it is ready, so that what waits for a
node that has gone holds up no job; a node that comes gets actors of its own.
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
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, TypeVar

from gensim2.core.cores import usable_cores
from gensim2.core.errors import InputError, MissingExtraError, NotRunError
from gensim2.core.processes import ray_head
from gensim2.core.processes.executor import TRIES, Failure, Job, Outcome, WorkerStartError
from gensim2.core.processes.pool import JOBS_PER_WORKER, TIME_LIMIT
from gensim2.core.processes.ray_head import LOOK_SECONDS, Head, Latest
from gensim2.core.processes.tries import Tries
from gensim2.core.processes.worker import SINGLE_THREADED, START_LIMIT, answer

Result = TypeVar("Result")

_ADDRESS = re.compile(r"local|auto|[\w.-]+:\d{1,5}|\[[0-9a-fA-F:]+\]:\d{1,5}")


def check_address(address: str) -> None:
    """Refuse what is no address, without starting anything.

    Raises:
        InputError: it is neither ``"local"``, ``"auto"`` nor ``HOST:PORT``.
        MissingExtraError: Ray is not installed.
    """
    if not _ADDRESS.fullmatch(address):
        raise InputError(
            f"{address!r} is no address of Ray", field="--ray", remedy="local, auto, or HOST:PORT of the head node"
        )
    if importlib.util.find_spec("ray") is None:
        raise MissingExtraError("ray", "ray")


class _Environment:
    """Body of an actor: imports, gets ready, runs jobs."""

    def __init__(self, path: Sequence[str], modules: Sequence[str], prepare: bytes) -> None:
        sys.path.extend(folder for folder in path if folder not in sys.path)  # jobs are functions by name
        for name in modules:
            with contextlib.suppress(ImportError):  # the jobs will complain about it
                importlib.import_module(name)
        with contextlib.suppress(Exception):  # what is wrong will be wrong for the job, which says so
            function = pickle.loads(prepare)
            if function is not None:
                function()

    def ready(self) -> None:
        """Answer once the environment is there."""

    def run(self, payload: bytes) -> bytes:
        """Run one job."""
        return answer(payload)


class _Place:
    """One actor, and the job that it is busy with."""

    def __init__(self, actor: Any) -> None:
        self.actor = actor
        self.awaited = actor.ready.remote()
        self.is_ready = False
        self.job: Job | None = None
        self.since = time.monotonic()
        self.served = 0

    @property
    def is_idle(self) -> bool:
        return self.is_ready and self.job is None

    def send(self, job: Job, payload: bytes) -> None:
        self.job, self.since = job, time.monotonic()
        self.awaited = self.actor.run.remote(payload)


class RayPool:
    """An :class:`~gensim2.core.processes.executor.Executor` on Ray.

    Args:
        address: ``"local"`` for a cluster of this process's own, ``"auto"`` or ``HOST:PORT`` for one that is there.
        workers: the most actors at a time; None: one for each CPU that the cluster has at the moment.
        time_limit, jobs_per_worker, preload, prepare, on_failure: as of :class:`~gensim2.core.processes.WorkerPool`.

    Raises:
        InputError: no cluster answers at the address, or one of another version.
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
        check_address(address)
        import ray

        self._ray, self._workers = ray, workers
        self._time_limit, self._jobs_per_worker, self._on_failure = time_limit, jobs_per_worker, on_failure
        self._arguments = (tuple(sys.path), tuple(preload), pickle.dumps(prepare))
        self._places: list[_Place] = []
        self._ran = False
        self._looked, self._target, self._failed_starts, self._alive = 0.0, 0, 0, time.monotonic()
        _connect(ray, address, workers)
        self._head = Head(ray.get_runtime_context().gcs_address)
        self._cpus = Latest(lambda: int(ray.cluster_resources().get("CPU", 0)))
        self._remote = ray.remote(num_cpus=1, max_restarts=0)(_Environment)

    def __enter__(self) -> RayPool:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the actors, whatever they are doing, and leave the cluster."""
        for place in list(self._places):
            self._end(place)
        if self._head.is_gone:  # there is none to leave, and Ray would wait for it until it ends this process
            atexit.unregister(self._ray.shutdown)
            ray_head.left_waiting = True
        else:
            self._ray.shutdown()

    def map_unordered(self, function: Callable[..., Result], jobs: Iterable[Job | None]) -> Iterator[Outcome[Result]]:
        """As in :class:`~gensim2.core.processes.executor.Executor`. A caller that stops early loses what was under way.

        Raises:
            NotRunError: the head of the cluster is gone.
            WorkerStartError: where actors cannot start at all.
        """
        tries = Tries(jobs, self._on_failure, self._ran)
        finished: deque[Outcome[Result]] = deque()
        next_job: Job | None = None
        self._alive = time.monotonic()
        try:
            while True:
                next_job = next_job or tries.next()
                if self._head.look() and next_job is not None:
                    self._look()
                    if idle := next((place for place in self._places if place.is_idle), None):
                        idle.send(next_job, pickle.dumps((function, next_job.arguments)))
                        next_job = None
                        continue
                if finished:
                    yield finished.popleft()
                elif next_job is not None or any(place.job for place in self._places):
                    self._require_head(next_job)
                    finished.extend(self._collect(tries))
                else:
                    return
        finally:
            for place in list(self._places):
                if place.job is not None:
                    self._end(place)

    def _require_head(self, waiting: Job | None) -> None:
        if self._head.is_gone:
            jobs = [job for job in (waiting, *(place.job for place in self._places)) if job is not None]
            reason = f"the head of the cluster, {self._head.address}, does not answer"
            raise NotRunError("jobs on Ray", {job.index: reason for job in jobs})

    def _look(self) -> None:
        """Have as many actors as the cluster has CPUs now, and no more."""
        if time.monotonic() - self._looked > LOOK_SECONDS:
            self._looked = time.monotonic()
            self._cpus.renew()
            there = self._cpus.value
            self._target = there if self._workers is None else min(there, self._workers)
            for place in [place for place in self._places if not place.is_ready][: self._surplus]:
                self._end(place)
        while self._surplus < 0:
            self._places.append(_Place(self._remote.remote(*self._arguments)))
        if any(place.is_ready for place in self._places):
            self._alive = time.monotonic()
        elif time.monotonic() - self._alive > START_LIMIT:
            raise WorkerStartError(f"no actor of the Ray cluster was ready in {START_LIMIT:g} s ({self._target} CPUs)")

    @property
    def _surplus(self) -> int:
        return len(self._places) - self._target

    def _collect(self, tries: Tries) -> list[Outcome[Any]]:
        """Wait until an actor has something to say, or it is time to look around; the outcomes."""
        awaited = {place.awaited: place for place in self._places if place.job is not None or not place.is_ready}
        if not awaited:
            time.sleep(LOOK_SECONDS)
            return []
        done, _ = self._ray.wait(list(awaited), num_returns=1, timeout=LOOK_SECONDS, fetch_local=True)
        outcomes: list[Outcome[Any]] = []
        for reference in done:
            place = awaited[reference]
            if place.job is None:
                self._started(place)
            else:
                outcomes.extend(tries.over(place.job, self._received(place, place.job, tries)))
        for place in awaited.values():
            if place.job is not None and time.monotonic() > place.since + self._time_limit:
                reason = f"took longer than {self._time_limit:g} s"
                outcomes.extend(tries.over(place.job, self._failure(place, place.job, tries, reason)))
        self._ran = tries.ran
        return outcomes

    def _started(self, place: _Place) -> None:
        try:
            self._ray.get(place.awaited)
            place.is_ready, self._failed_starts = True, 0
        except self._ray.exceptions.RayError as error:
            self._end(place)
            self._failed_starts += 1
            if self._failed_starts >= TRIES * max(self._target, 1):
                words = " ".join(str(error).split())
                raise WorkerStartError(f"actors of the Ray cluster end before their first job: {words}") from error

    def _received(self, place: _Place, job: Job, tries: Tries) -> Outcome[Any] | Failure:
        """Return the outcome of the job that an actor was busy with."""
        try:
            kind, value, text, cpu_s = pickle.loads(self._ray.get(place.awaited))
        except self._ray.exceptions.RayError as error:
            return self._failure(place, job, tries, f"the worker process died ({type(error).__name__})")
        if kind == "failure":
            return self._failure(place, job, tries, value, text)
        place.job, place.served = None, place.served + 1
        if place.served >= self._jobs_per_worker:
            self._end(place)
        return (
            Outcome(job.index, error=value, cpu_s=cpu_s) if kind == "error" else Outcome(job.index, value, cpu_s=cpu_s)
        )

    def _failure(self, place: _Place, job: Job, tries: Tries, reason: str, text: str | None = None) -> Failure:
        """End the actor, so that the next try is in a fresh process."""
        self._end(place)
        return Failure(job.index, tries.number(job), reason, text)

    def _end(self, place: _Place) -> None:
        if place in self._places:
            self._places.remove(place)
        place.job = None
        if self._head.is_there:
            with contextlib.suppress(Exception):  # it may be gone, and its node with it
                self._ray.kill(place.actor)


def _connect(ray: Any, address: str, workers: int | None) -> None:
    """Join the cluster, or make one; Ctrl-C and SIGTERM stay with whoever handles them now.

    Raises:
        InputError: it cannot be joined.
    """
    where: dict[str, Any] = {"address": address}
    if address == "local":  # said so, for without an address Ray looks for a cluster that another user has begun
        where |= {"num_cpus": workers or usable_cores(), "include_dashboard": False}
        where["_system_config"] = {"worker_niceness": 0}  # Ray's 15 leaves them nothing of a busy machine
    handlers = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        for number in range(TRIES):
            try:
                ray.init(
                    **where, logging_level=logging.ERROR, log_to_driver=False, runtime_env={"env_vars": _environment()}
                )
                return
            # Ray raises bare exceptions, too: a node of its own that takes over 15 s to start (its issue 65983).
            except Exception as error:
                ray.shutdown()
                if address != "local" or number == TRIES - 1:
                    words = " ".join(str(error).split())
                    raise InputError(f"no Ray cluster can be used there: {words}", field="--ray") from error
    finally:
        with contextlib.suppress(ValueError):  # not in the main thread, where no handler can have been set either
            for number, handler in handlers.items():
                signal.signal(number, handler)


def _environment() -> dict[str, str]:
    """Variables that a job's result may follow from, as they are here; and threads, one each."""
    return {**{name: value for name, value in os.environ.items() if name.startswith("GENSIM2_")}, **SINGLE_THREADED}

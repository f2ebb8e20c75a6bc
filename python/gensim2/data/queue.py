"""The queue of a collection: which episodes are done, which are to come, and what becomes of each.

What this process keeps does not grow with the episodes but for one byte each.
"""

from __future__ import annotations

import contextlib
import shutil
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from gensim2.data.folder import CollectionFolder, now
from gensim2.data.page import write_page
from gensim2.data.record import DatasetRecord, ObjectUsed
from gensim2.data.status import Listener, Status, TaskStatus
from gensim2.data.store import TaskStore
from gensim2.episodes.record import Episode
from gensim2.episodes.recording import Recording
from gensim2.errors import InputError, NotRunError
from gensim2.files import remove_temporaries
from gensim2.objects import Library
from gensim2.pipeline import worker
from gensim2.pipeline.evaluator import PoolEvaluator
from gensim2.pipeline.inputs import TaskInput
from gensim2.pipeline.runfolder import TaskFolder
from gensim2.processes import Job

UPDATE_SECONDS = 0.5
"""Between two words to whoever watches."""


@dataclass(frozen=True)
class Kept:
    """What a worker says of an episode that it has written down.

    Attributes:
        held, strict, cause: as of the episode.
        size: bytes of its file.
    """

    held: bool
    strict: bool
    cause: str | None
    size: int

    @staticmethod
    def of(episode: Episode, path: Path) -> Kept:
        """What is said of an episode whose file lies at ``path``."""
        cause = None if episode.cause is None else str(episode.cause)
        return Kept(episode.held, episode.strict, cause, path.stat().st_size)


def keep_episode(folder: Path, index: int, failures: bool, episode: Episode, recording: Recording | None) -> Kept:
    """Write an episode into its task's folder; called in the worker that ran it.

    Args:
        failures: keep the states of one that does not hold, too.
    """
    store = TaskStore(folder)
    store.add(index, episode, recording if episode.held or failures else None)
    return Kept.of(episode, store.path(index, episode.held))


class _TaskQueue:
    """The episodes of one task.

    Args:
        given: the task.
        store: its folder.
        record: of the data set.
    """

    def __init__(self, given: TaskInput, store: TaskStore, record: DatasetRecord) -> None:
        self.given, self.store, self._record = given, store, record
        self.name, self.total = given.spec.name, record.episodes
        self._forget()

    def _forget(self) -> None:
        self.done = bytearray(self.total)
        self.tried = self.held = self.strict = self.size = 0
        self.causes: Counter[str] = Counter()

    @property
    def is_done(self) -> bool:
        return self.tried == self.total

    @property
    def status(self) -> TaskStatus:
        causes = dict(sorted(self.causes.items(), key=lambda item: (-item[1], item[0])))
        return TaskStatus(self.name, self.total, self.tried, self.held, self.strict, causes)

    def seed(self, index: int) -> int:
        return self._record.scene_seed(self.name, index)

    def count(self, index: int, kept: Kept) -> None:
        """Take note of a finished episode."""
        self.done[index] = 1
        self.tried += 1
        self.held += kept.held
        self.strict += kept.strict
        self.size += kept.size
        if kept.cause is not None:
            self.causes[kept.cause] += 1

    def read(self) -> int:
        """Take note of what earlier runs left, remove what is damaged, and return how much that was.

        Raises:
            InputError: an episode is not of this collection, or another version of gensim2 wrote it.
        """
        damaged = 0
        for found in self.store.found():
            if found.row is None:
                found.path.unlink()
                damaged += 1
                continue
            episode = found.row.episode
            foreign = found.index >= self.total or episode.seed != self.seed(found.index)
            if foreign or self.done[found.index]:
                reason = "is not of this collection" if foreign else "is there twice"
                raise InputError(reason, file=found.path, remedy="delete it and resume")
            self.count(found.index, Kept.of(episode, found.path))
        return damaged

    def is_complete(self) -> bool:
        """Whether ``episodes.jsonl`` and all that it tells of are there and whole; then they are taken note of."""
        with contextlib.suppress(InputError):
            for number, row in enumerate(self.store.rows()):
                seems_right = row.index == number < self.total and row.seed == self.seed(number)
                if not seems_right or not self.store.is_complete(row):
                    break
                self.count(number, Kept.of(row, self.store.path(number, row.held)))
            if self.is_done and not self._lies_more_there():
                return True
        self._forget()
        return False

    def _lies_more_there(self) -> bool:
        folders = [self.store.path(0, held).parent for held in (True, False)]
        return sum(len(list(folder.iterdir())) for folder in folders if folder.is_dir()) != self.total

    def jobs(self, evaluator: PoolEvaluator, first: int) -> Iterator[Job]:
        """What is to come, numbered from ``first`` on."""
        setting = evaluator.setting(self.given.spec, self.given.instances)
        for index in range(self.total):
            if not self.done[index]:
                keep = partial(keep_episode, self.store.folder, index, self._record.keep_failures)
                yield Job(first + index, (setting, self.given.strategies, self.seed(index), keep))


class Queue:
    """All episodes of a collection.

    Args:
        folder: of the data set.
        given: the tasks, in order.
        listener: is told how far it is.

    Raises:
        InputError: what an earlier run left cannot be used.
    """

    def __init__(self, folder: CollectionFolder, given: Sequence[TaskInput], listener: Listener) -> None:
        self._folder, self._listener, self._library = folder, listener, given[0].library
        self._record = folder.dataset.record
        self._tasks = [_TaskQueue(one, folder.dataset.task(one.spec.name), self._record) for one in given]
        self._ran, self._begin, self._told = 0, time.monotonic(), 0.0
        self._evaluator: PoolEvaluator | None = None
        for task in self._tasks:
            files = TaskFolder(task.store.folder)
            files.write_task(task.given.spec)
            files.write_strategies(task.given.strategies)

    def run(self, evaluator: PoolEvaluator) -> Status:
        """Run what is not done; leave the data set complete, with its report.

        Raises:
            WriteError, NotRunError, InputError: as :func:`gensim2.data.collection.collect`.
        """
        self._evaluator = evaluator
        try:
            whole = self._read()
            self._begin = time.monotonic()
            self._run(evaluator, whole)
            remove_temporaries(self._folder.path)  # a worker that was killed while it wrote leaves one
            self._record.complete = True
            self._folder.dataset.save()
        except BaseException:
            with contextlib.suppress(InputError):  # a full disk has no room for a report either, and is what is told
                self._report()
            raise
        self._report()
        return self.status()

    def status(self) -> Status:
        """How far it is."""
        return Status(
            tuple(task.status for task in self._tasks),
            self._ran,
            time.monotonic() - self._begin,
            sum(task.size for task in self._tasks),
            shutil.disk_usage(self._folder.path).free,
            self._evaluator.failed_tries if self._evaluator is not None else 0,
        )

    def _read(self) -> set[str]:
        """Take note of what is there; the tasks whose rows stand, too."""
        whole, damaged = set(), 0
        for task in self._tasks:
            if task.is_complete():
                whole.add(task.name)
                self._add_objects(task)
            else:
                damaged += task.read()
        if damaged:
            self._listener.message(f"{damaged} episode files are damaged and are made again")
        if there := sum(task.tried for task in self._tasks):
            self._listener.message(f"{there} of {self.status().total} episodes are there already")
        return whole

    def _run(self, evaluator: PoolEvaluator, whole: set[str]) -> None:
        for task in self._tasks:
            if task.is_done and task.name not in whole:
                self._finish(task)
        total = self._record.episodes
        jobs = (job for number, task in enumerate(self._tasks) for job in task.jobs(evaluator, number * total))
        try:
            for number, kept in evaluator.run(worker.record, jobs, "collection"):
                task, index = self._tasks[number // total], number % total
                task.count(index, kept)
                self._ran += 1
                self._tell()
                if task.is_done:
                    self._finish(task)
        except NotRunError as error:
            raise self._named(error) from error
        finally:
            self._tell(at_once=True)

    def _finish(self, task: _TaskQueue) -> None:
        """Write the rows of a task all of whose episodes are there."""
        for _ in task.store.write_rows(task.total):
            pass
        self._add_objects(task)

    def _add_objects(self, task: _TaskQueue) -> None:
        """Note what a task came to, and the objects that its episodes were run with.

        Raises:
            InputError: an object is not the one any more that an episode was run with.
        """
        objects = self._record.objects
        for row in task.store.rows():
            for thing in row.objects.values():
                key = f"{thing.asset_class}/{thing.id}"
                used = objects[key] = objects.get(key) or _used(self._library, thing.asset_class, thing.id)
                if used.content_hash != thing.content_hash:
                    raise InputError(
                        f"was run with another {key} than there is now",
                        file=task.store.path(row.index, row.held),
                        remedy="restore the object, or delete the file and resume",
                    )
        self._record.objects = dict(sorted(objects.items()))
        entry, status = self._record.tasks[task.name], task.status
        entry.tried, entry.held, entry.strict, entry.causes = status.tried, status.held, status.strict, status.causes
        self._folder.dataset.save()

    def _named(self, error: NotRunError) -> NotRunError:
        """The error with the indices of the first task that it is of."""
        total = self._record.episodes
        concerned = sorted({number // total for number in error.reasons})
        first = concerned[0]
        others = f" (and of {len(concerned) - 1} other tasks)" if len(concerned) > 1 else ""
        reasons = {number % total: why for number, why in error.reasons.items() if number // total == first}
        return NotRunError(f"episodes of {self._tasks[first].name}{others}", reasons, error.log)

    def _tell(self, at_once: bool = False) -> None:
        if at_once or time.monotonic() - self._told > UPDATE_SECONDS:
            self._told = time.monotonic()
            self._listener.update(self.status())

    def _report(self) -> None:
        """Leave ``run.json`` and ``report.html`` behind."""
        status = self.status()
        run = self._folder.note(
            {
                "finished": now(),
                "complete": self._record.complete,
                "episodes_run": status.ran,
                "seconds": round(status.seconds, 3),
                "episodes_per_second": None if status.rate is None else round(status.rate, 4),
                "failed_tries": status.failed_tries,
                "bytes": status.stored,
            }
        )
        write_page(self._folder.dataset, status, run)


def _used(library: Library, asset_class: str, id: str) -> ObjectUsed:
    model = library.load(asset_class, id)
    return ObjectUsed(content_hash=model.content_hash, license=model.license)

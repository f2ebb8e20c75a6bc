"""Manage the folder of a collection. Find the episodes that were not run yet, run them, and write the report.

For each episode, this module keeps only one byte in memory, so that a collection can have many episodes.
"""

from __future__ import annotations

import contextlib
import platform
import shlex
import shutil
import socket
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from gensim2.core.errors import InputError
from gensim2.core.files import write_atomic, write_json
from gensim2.core.pages import template
from gensim2.core.progress import Progress, now
from gensim2.core.resumable import ResumableFolder, command_line
from gensim2.data.card import card
from gensim2.data.dataset import DATASET_JSON, DataSet
from gensim2.data.record import DatasetRecord, ObjectUsed
from gensim2.data.runfolder import TaskFolder
from gensim2.data.status import Status
from gensim2.data.task_queue import Quota, TaskQueue, run_queues
from gensim2.objects import Library
from gensim2.rollout.inputs import TaskInput
from gensim2.rollout.runner import EpisodeRunner
from gensim2.rollout.tally import interval

UPDATE_SECONDS = 0.5
"""Time between two status updates, s."""
RUN_JSON, ERRORS_LOG, REPORT = "run.json", "errors.log", "report.html"
"""Files that differ between runs; ``dataset.json`` determines the content of all other files."""


LABELS = {
    "assets": "objects",
    "randomization": "randomization of the scenes",
    "engine": "physics engine",
    "open_loop": "open loop: all motions planned at the start",
    "one_plan": "each step planned only once",
    "attempts": "maximum number of attempts in an episode",
    "noise": "noise on the commands of the arm (rad)",
    "engines": "physics engines in which an episode runs",
    "scene_source": "scene of the planner",
    "depth_noise": "noise of the depth cameras",
}
"""Names on the page of the options of scenes and rollouts, for options with another name on the page."""


def write_page(dataset: DataSet, status: Status, run: Mapping[str, Any]) -> Path:
    """Write ``report.html`` and return its path.

    Args:
        status: progress of the collection.
        run: contents of ``run.json``.

    Raises:
        WriteError: the folder cannot be written to.
    """
    arguments = {LABELS.get(name, name): value for name, value in dataset.record.arguments.items()}
    licenses: dict[str, list[str]] = {}
    for name, used in dataset.record.objects.items():
        licenses.setdefault(used.license, []).append(name)
    page = template("gensim2.data", "collection.html.j2").render(
        record=dataset.record.model_dump(),
        arguments=arguments,
        intervals={task.name: interval(task.held, task.tried) for task in status.tasks},
        status=status,
        run=dict(run),
        licenses=licenses,
        shown=shlex.join(["gensim2", "data", "report", str(dataset.path)]),
    )
    path = dataset.path / REPORT
    write_atomic(path, page)
    return path


class CollectionFolder(ResumableFolder[DatasetRecord]):
    """Context manager that locks the folder of a collection.

    Args:
        path: the folder; it is created if missing.
        record: settings. When a collection is resumed, only the numbers of episodes and tasks may grow.
        resume: continue an existing data set.
        process: facts about this call (such as the number of workers), stored in ``run.json``.

    Raises:
        InputError: the folder is in use or not writable, or it has other settings or files, or it has data and
            ``resume`` is false.
    """

    def __init__(self, path: Path, record: DatasetRecord, resume: bool, process: dict[str, Any]) -> None:
        super().__init__(path, DATASET_JSON, record, holds="a data set", resume=resume)
        self.dataset = DataSet(path, self.record)
        self._run: dict[str, Any] = {
            "command_line": command_line(),
            "host": socket.gethostname(),
            "platform": platform.platform(),
            "folder": str(path.resolve()),
            "started": now(),
            "finished": None,
            **process,
        }
        self.note({})

    def note(self, progress: dict[str, Any]) -> dict[str, Any]:
        self._run |= progress
        write_json(self.path / RUN_JSON, self._run)
        return self._run


class Queue:
    """All episodes of a collection.

    Args:
        folder: folder of the data set.
        given: tasks with their strategies, in the order of the command.
        listener: receives the status of the collection.

    Raises:
        InputError: files of an earlier run cannot be used.
    """

    def __init__(self, folder: CollectionFolder, given: Sequence[TaskInput], listener: Progress) -> None:
        self._folder, self._listener, self._library = folder, listener, given[0].library
        self._record = folder.dataset.record
        self._tasks = [self._queue(one) for one in given]
        self._ran, self._begin, self._told = 0, time.monotonic(), 0.0
        self._warm: float | None = None
        self._evaluator: EpisodeRunner | None = None
        self._objects: dict[str, ObjectUsed] = {}
        for task in self._tasks:
            files = TaskFolder(task.store.folder)
            files.write_task(task.task)
            files.write_strategies(task.strategies)

    def _queue(self, given: TaskInput) -> TaskQueue:
        name = given.spec.name
        return TaskQueue(
            given.spec,
            given.strategies,
            given.scene.instances,
            self._folder.dataset.task(name),
            partial(self._record.scene_seed, name),
            Quota(self._record.episodes),
            keep_failures=self._record.keep_failures,
        )

    def run(self, evaluator: EpisodeRunner) -> Status:
        """Run the missing episodes, then mark the data set as complete and write its report."""
        self._evaluator = evaluator
        try:
            whole = self._read()
            self._begin = time.monotonic()
            self._run(evaluator, whole)
            self._record.complete = True
            self._folder.dataset.save()
            if any(task.status.held for task in self._tasks):
                card(self._folder.path)
        except BaseException:
            # Suppress an error of this report, such as a full disk, so that the error of the collection is raised.
            with contextlib.suppress(InputError):
                self._report()
            raise
        self._report()
        return self.status()

    def status(self) -> Status:
        return Status(
            tuple(task.status for task in self._tasks),
            self._ran,
            time.monotonic() - self._begin,
            sum(task.size for task in self._tasks),
            shutil.disk_usage(self._folder.path).free,
            self._evaluator.failed_tries if self._evaluator is not None else 0,
            self._pace(),
        )

    def _pace(self) -> float | None:
        """Return the mean time between two episodes, s, from the second episode of each worker on."""
        if self._evaluator is None or self._warm is None or self._ran < 2 * self._evaluator.workers:
            return None
        return (time.monotonic() - self._warm) / (self._ran - self._evaluator.workers)

    def _read(self) -> set[str]:
        """Read the finished episodes and return the names of tasks that are complete."""
        whole, damaged = set(), 0
        for task in self._tasks:
            if task.is_complete():
                whole.add(task.name)
                self._add_objects(task)
            else:
                damaged += task.read()
                entry = self._record.tasks[task.name]
                entry.tried = entry.held = entry.strict = None
                entry.causes, self._record.complete = {}, False
        self._folder.dataset.save()
        if damaged:
            self._listener.message(f"{damaged} episode files are damaged; their episodes are run again")
        if there := sum(task.tried for task in self._tasks):
            self._listener.message(f"{there} of {self.status().total} episodes are finished already")
        return whole

    def _run(self, evaluator: EpisodeRunner, whole: set[str]) -> None:
        for task in self._tasks:
            if task.is_done and task.name not in whole:
                self._finish(task)
        if not all(task.is_done for task in self._tasks):
            self._tell(at_once=True)
        try:
            run_queues(self._tasks, evaluator, self._counted)
        finally:
            self._tell(at_once=True)

    def _counted(self, task: TaskQueue) -> None:
        self._ran += 1
        if self._evaluator is not None and self._ran == self._evaluator.workers:
            self._warm = time.monotonic()
        self._tell()
        if task.is_done:
            self._finish(task)

    def _finish(self, task: TaskQueue) -> None:
        task.finish()
        self._add_objects(task)

    def _add_objects(self, task: TaskQueue) -> None:
        """Copy the results and the used objects of a finished task into ``dataset.json``."""
        objects = self._record.objects
        for row in task.store.rows():
            for thing in row.objects.values():
                key = f"{thing.asset_class}/{thing.id}"
                # Read each object only once to compare its hash with the hash in each episode.
                if key not in self._objects:
                    self._objects[key] = _used(self._library, thing.asset_class, thing.id)
                used = objects[key] = self._objects[key]
                if used.content_hash != thing.content_hash:
                    raise InputError(
                        f"the episode was recorded with a different version of the object {key}",
                        file=task.store.path(row.index, row.held),
                        remedy="restore that version of the object, or delete the file and resume",
                    )
        self._record.objects = dict(sorted(objects.items()))
        entry, status = self._record.tasks[task.name], task.status
        entry.tried, entry.held, entry.strict, entry.causes = status.tried, status.held, status.strict, status.causes
        self._folder.dataset.save()

    def _tell(self, at_once: bool = False) -> None:
        if at_once or time.monotonic() - self._told > UPDATE_SECONDS:
            self._told = time.monotonic()
            self._listener.update(self.status())

    def _report(self) -> None:
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

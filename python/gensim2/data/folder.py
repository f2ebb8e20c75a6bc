"""The folder of a collection: new or gone on with, one owner at a time, described before its first episode."""

from __future__ import annotations

import platform
import socket
import sys
import time
from pathlib import Path
from typing import Any

from gensim2.core.errors import InputError
from gensim2.core.files import write_json
from gensim2.data.dataset import DATASET_JSON, DataSet
from gensim2.data.owned_folder import OwnedFolder
from gensim2.data.record import DatasetRecord

RUN_JSON, ERRORS_LOG, REPORT = "run.json", "errors.log", "report.html"
"""Files that record when, where and how; everything else in the folder follows from ``dataset.json``."""

_REMEDY = "go on with the same, or choose another --out"


class CollectionFolder(OwnedFolder):
    """A context manager: leaving it gives the folder up.

    Args:
        path: the folder; it is made where it is not there, also to ``resume``.
        record: what the collection is to be. A data set that is gone on with may get more episodes and more tasks;
            everything else must be as it was.
        resume: go on with a data set that is there.
        process: facts of this run alone (workers, for example), for ``run.json``.

    Raises:
        InputError: the folder holds a data set and ``resume`` is off, or another one, or something else, or another
            process is at work in it, or it cannot be written.
    """

    def __init__(self, path: Path, record: DatasetRecord, resume: bool, process: dict[str, Any]) -> None:
        super().__init__(path, DATASET_JSON, "a data set", resume)
        with self.released_on_error():
            if (path / DATASET_JSON).exists():
                before = DataSet.open(path).record
                _compare(path / DATASET_JSON, before, record)
                _carry_over(before, record)
            self.dataset = DataSet(path, record)
            self.dataset.save()
            self._run: dict[str, Any] = {
                "command_line": sys.argv[1:],
                "host": socket.gethostname(),
                "platform": platform.platform(),
            }
            self._run |= {"folder": str(path.resolve()), "started": now(), "finished": None, **process}
            self.note({})

    @property
    def path(self) -> Path:
        """The folder."""
        return self.dataset.path

    def note(self, progress: dict[str, Any]) -> dict[str, Any]:
        """Write ``run.json`` and return what it holds."""
        self._run |= progress
        write_json(self.path / RUN_JSON, self._run)
        return self._run


def _compare(file: Path, before: DatasetRecord, now: DatasetRecord) -> None:
    """Refuse to go on with another data set.

    Raises:
        InputError: names the first field that differs.
    """
    for name in ("arguments", "versions"):
        old, new = getattr(before, name), getattr(now, name)
        for key in sorted(old.keys() | new.keys()):
            if old.get(key) != new.get(key):
                text = f"the collection was begun with {old.get(key)!r}, not {new.get(key)!r}"
                raise InputError(text, file=file, field=f"{name}.{key}", remedy=_REMEDY)
    for name in ("seed", "keep_failures"):
        if getattr(before, name) != getattr(now, name):
            text = f"the collection was begun with {getattr(before, name)}, not {getattr(now, name)}"
            raise InputError(text, file=file, field=name, remedy=_REMEDY)
    if now.episodes < before.episodes:
        text = f"the collection was begun with {before.episodes}; it may get more, not fewer than that"
        raise InputError(text, file=file, field="episodes", remedy=_REMEDY)
    if list(now.tasks)[: len(before.tasks)] != list(before.tasks):
        text = "the collection was begun with these tasks in this order; further ones may follow"
        raise InputError(f"{text}: {', '.join(before.tasks)}", file=file, field="tasks", remedy=_REMEDY)
    for asset_class, listing in sorted(before.listings.items()):
        if now.listings.get(asset_class) != listing:
            text = f"the objects of class {asset_class} have changed since the collection was begun"
            raise InputError(text, file=file, field=f"listings.{asset_class}", remedy=_REMEDY)
    for name, task in before.tasks.items():
        other = now.tasks[name]
        if (other.digest, other.instances, other.objects) != (task.digest, task.instances, task.objects):
            text = "the task, its strategies or its instances have changed since the collection was begun"
            raise InputError(text, file=file, field=f"tasks.{name}", remedy=_REMEDY)


def _carry_over(before: DatasetRecord, now: DatasetRecord) -> None:
    """Keep what is known of the episodes that are there: until new ones are, the data set is what it was."""
    now.objects = dict(before.objects)
    if (now.episodes, list(now.tasks)) == (before.episodes, list(before.tasks)):
        now.tasks, now.complete = dict(before.tasks), before.complete


def now() -> str:
    """The time, with its zone."""
    return time.strftime("%Y-%m-%dT%H:%M:%S%z")

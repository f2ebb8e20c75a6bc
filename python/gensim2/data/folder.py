"""The folder of a collection: new or gone on with, one owner at a time, described before its first episode."""

from __future__ import annotations

import platform
import socket
import sys
import time
from pathlib import Path
from typing import Any

from gensim2.core.files import write_json
from gensim2.core.resumable import ResumableFolder
from gensim2.data.dataset import DATASET_JSON, DataSet
from gensim2.data.record import DatasetRecord

RUN_JSON, ERRORS_LOG, REPORT = "run.json", "errors.log", "report.html"
"""Files that record when, where and how; everything else in the folder follows from ``dataset.json``."""


class CollectionFolder(ResumableFolder[DatasetRecord]):
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
        super().__init__(path, DATASET_JSON, record, holds="a data set", resume=resume)
        self.dataset = DataSet(path, self.record)
        self._run: dict[str, Any] = {
            "command_line": sys.argv[1:],
            "host": socket.gethostname(),
            "platform": platform.platform(),
            "folder": str(path.resolve()),
            "started": now(),
            "finished": None,
            **process,
        }
        self.note({})

    def note(self, progress: dict[str, Any]) -> dict[str, Any]:
        """Write ``run.json`` and return what it holds."""
        self._run |= progress
        write_json(self.path / RUN_JSON, self._run)
        return self._run


def now() -> str:
    """The time, with its zone."""
    return time.strftime("%Y-%m-%dT%H:%M:%S%z")

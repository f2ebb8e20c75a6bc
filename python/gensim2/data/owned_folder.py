"""A folder that one process at a time writes to, and that a later one may go on with."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Self

from gensim2.core.errors import InputError
from gensim2.core.files import remove_temporaries
from gensim2.data.lock import FolderLock


class OwnedFolder:
    """A folder under a lock. A context manager: leaving it gives the folder up.

    Args:
        path: the folder; it is made where it is not there.
        marker: name of the file by which such a folder is known.
        holds: what the marker stands for, in words (``"a run"``).
        resume: go on with a folder that holds the marker.

    Raises:
        InputError: the folder holds the marker and ``resume`` is off, or something else, or another process is at work
            in it, or it cannot be written.
    """

    def __init__(self, path: Path, marker: str, holds: str, resume: bool) -> None:
        self._folder, self._marker, self._holds = path, marker, holds
        self._check(resume)
        self._lock = FolderLock(path)
        with self.released_on_error():
            self._check(resume)  # what another process did until we had the lock
            remove_temporaries(path)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        try:
            remove_temporaries(self._folder)  # a worker that was killed while it wrote leaves one
        finally:
            self._lock.release()

    @contextlib.contextmanager
    def released_on_error(self) -> Iterator[None]:
        """Give the folder up where what is done in this context fails."""
        try:
            yield
        except BaseException:
            self._lock.release()
            raise

    def _check(self, resume: bool) -> None:
        path = self._folder
        if not path.exists():
            return
        if not path.is_dir():
            raise InputError("is not a folder", file=path, remedy="choose another --out")
        if (path / self._marker).exists():
            if not resume:
                raise InputError(
                    f"holds {self._holds} already", file=path, remedy="add --resume, or choose another --out"
                )
        elif any(entry.name != FolderLock.NAME for entry in path.iterdir() if not self._is_leftover(entry)):
            held = self._holds.removeprefix("a ")
            raise InputError(f"is not empty and holds no {held}", file=path, remedy="choose another --out")

    def _is_leftover(self, path: Path) -> bool:
        return path.name.startswith(f".{self._marker}.")

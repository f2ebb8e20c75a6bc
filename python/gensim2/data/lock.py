"""One owner a folder: a lock that ends with the process that holds it, however that ends."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Self

from filelock import FileLock, Timeout

from gensim2.core.errors import InputError, WriteError
from gensim2.core.foreign.tree import ForeignTree


class FolderLock:
    """The lock of a folder, which is made if need be. Held from here to ``release`` or to the end of the process.

    Files of the folder are replaced and links are followed, so no link may lead out of it.

    The file stays: removing it would let two processes hold locks on two files of one name. It says who holds it.
    A context manager: leaving it releases the lock.

    Args:
        folder: the folder.
        name: of the lock's file; a run that calls another one on the same folder has a lock of its own.

    Raises:
        InputError: another process holds it, a link leads out of the folder, or it cannot be written to.
    """

    NAME = ".lock"

    def __init__(self, folder: Path, name: str = NAME) -> None:
        path = folder / name
        self._lock = FileLock(path, blocking=False, thread_local=False, fallback_to_soft=False)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            ForeignTree(folder).refuse_links_out()
            self._lock.acquire()
        except Timeout as error:
            owner = path.read_text(encoding="ascii", errors="replace").strip()[:32]
            by = f" (process {owner})" if owner else ""
            raise InputError(
                f"another run is at work in it{by}", file=folder, remedy="wait for it, or choose another folder"
            ) from error
        except OSError as error:
            self._lock.release()
            raise InputError(
                f"cannot write: {error.strerror}",
                file=folder,
                remedy="choose another folder with --out, on a local disk",
            ) from error
        try:
            path.write_text(f"{os.getpid()}\n", encoding="ascii")
        except OSError as error:
            self._lock.release()
            remedy = "make room, or choose another folder"
            raise WriteError(f"cannot write: {error.strerror}", file=path, remedy=remedy) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def release(self) -> None:
        """Let others have the folder."""
        self._lock.release()

"""One owner a folder: a lock that ends with the process that holds it, however that ends."""

from __future__ import annotations

import errno
import fcntl
import os
from pathlib import Path

from gensim2.errors import InputError


class FolderLock:
    """The lock of a folder, which is made if need be. Held from here to ``release`` or to the end of the process.

    The file stays: removing it would let two processes hold locks on two files of one name.

    Raises:
        InputError: another process holds it, or the folder cannot be written to.
    """

    NAME = ".lock"

    def __init__(self, folder: Path) -> None:
        path = folder / self.NAME
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise InputError(
                f"cannot write: {error.strerror}", file=folder, remedy="choose another folder with --out"
            ) from error
        try:
            fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            owner = os.pread(self._handle, 32, 0).decode("ascii", "replace").strip()
            os.close(self._handle)
            if error.errno not in (errno.EWOULDBLOCK, errno.EACCES):
                raise InputError(
                    f"cannot be locked: {error.strerror}", file=folder, remedy="choose a folder on a local disk"
                ) from error
            by = f" (process {owner})" if owner else ""
            raise InputError(
                f"another run is at work in it{by}", file=folder, remedy="wait for it, or choose another --out"
            ) from error
        os.ftruncate(self._handle, 0)
        os.pwrite(self._handle, f"{os.getpid()}\n".encode(), 0)

    def release(self) -> None:
        """Let others have the folder."""
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1

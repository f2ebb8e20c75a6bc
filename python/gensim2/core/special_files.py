"""Write to special files (devices and pipes), which an atomic write would replace.

Users may name a device, a pipe, or an open descriptor (``/dev/stdout``, ``>(...)``) as an output file.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

#: A path with more symbolic links than this counts as a loop, as in the Linux kernel.
MAX_LINKS = 40


def descriptor(path: Path) -> int | None:
    """Return the open descriptor that ``path`` names, such as 1 for ``/dev/stdout``; None if it names none."""
    own = Path(f"/proc/{os.getpid()}/fd")
    for _ in range(MAX_LINKS):
        folder = Path(os.path.realpath(path.parent))
        if folder == own and path.name.isdecimal():
            return int(path.name)
        if not path.is_symlink():
            return None
        path = folder / path.readlink()
    return None


def is_special(path: Path) -> bool:
    """Return whether ``path`` is a special file.

    Raises:
        OSError: the path is a folder, or cannot be inspected.
    """
    if descriptor(path) is not None:
        return True
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return False
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    return not stat.S_ISREG(mode)


def write_through(path: Path, payload: bytes) -> None:
    """Write to a special file. Writing to a pipe waits until another process reads the pipe.

    Raises:
        OSError: the file cannot be written to, or the disk is full.
    """
    number = descriptor(path)
    if number is not None:
        with os.fdopen(os.dup(number), "wb") as stream:
            stream.write(payload)
    else:
        with path.open("wb") as stream:
            stream.write(payload)

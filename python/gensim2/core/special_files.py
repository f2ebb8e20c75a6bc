"""Special files, such as devices and pipes: they are written through, never replaced.

A file that a user names may be a device (``/dev/full``), a pipe or an open descriptor (``/dev/stdout``, a
shell's ``>(...)``). To put a new file in its place, as an atomic write does, would destroy it.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

#: Symbolic links that are followed before a name counts as a loop, as in the kernel.
MAX_LINKS = 40


def descriptor(path: Path) -> int | None:
    """The open descriptor of this process that ``path`` stands for, or None: 1 for ``/dev/stdout``."""
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
    """Whether something stands under ``path`` that is to be written through.

    Raises:
        OSError: a folder stands there, or the system cannot say.
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
    """Write to what :func:`is_special` found; a pipe waits for its reader.

    Raises:
        OSError: it cannot be written to, or is full.
    """
    number = descriptor(path)
    if number is not None:
        with os.fdopen(os.dup(number), "wb") as stream:
            stream.write(payload)
    else:
        with path.open("wb") as stream:
            stream.write(payload)

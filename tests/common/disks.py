"""Small or read-only file systems for commands in subprocesses; a folder can become read-only during a run."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path


def can_mount() -> bool:
    """Return whether a process may mount a file system of its own."""
    words = ["unshare", "--mount", "mount", "-t", "tmpfs", "none", "/mnt"]
    return shutil.which("unshare") is not None and subprocess.run(words, capture_output=True).returncode == 0


def on_disk(options: str, folder: Path) -> tuple[str, ...]:
    """Return the command prefix that mounts a tmpfs with the given options at ``folder``."""
    script = f'mount -t tmpfs -o {options} none "$0" && shift 0 && exec "$@"'
    return ("unshare", "--mount", "sh", "-c", script, str(folder))


#: Command prefix of a process for which :func:`make_read_only` can change folders.
OWN_MOUNTS = ("unshare", "--mount")


def make_read_only(folder: Path, pid: int) -> None:
    """Make a folder read-only for a running process that was started with ``OWN_MOUNTS``, and for its workers.

    For all other processes the folder stays as it is, so a later run can write to it.
    """
    script = 'mount --bind "$0" "$0" && mount -o remount,bind,ro "$0"'
    words = ["nsenter", "--mount", "--target", str(pid), "sh", "-c", script, str(folder)]
    subprocess.run(words, check=True, capture_output=True)

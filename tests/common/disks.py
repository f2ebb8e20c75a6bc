"""Small or read-only file systems for commands in subprocesses."""

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

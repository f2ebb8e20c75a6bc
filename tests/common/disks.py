"""Disks that are small or read-only, for commands in processes of their own."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path


def can_mount() -> bool:
    """Whether a process may mount a file system of its own."""
    words = ["unshare", "--mount", "mount", "-t", "tmpfs", "none", "/mnt"]
    return shutil.which("unshare") is not None and subprocess.run(words, capture_output=True).returncode == 0


def on_disk(options: str, folder: Path) -> tuple[str, ...]:
    """Words before a command that mount an empty disk at ``folder`` for it, with these options of tmpfs."""
    script = f'mount -t tmpfs -o {options} none "$0" && shift 0 && exec "$@"'
    return ("unshare", "--mount", "sh", "-c", script, str(folder))

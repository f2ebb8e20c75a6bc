"""The processor's cores that this process may use."""

from __future__ import annotations

import os

SWITCH_INTERVAL = 0.0005
"""Seconds after which a thread gives up the interpreter to a thread that has a deadline (5 ms by default)."""


def usable_cores() -> int:
    """Count them: those that its affinity leaves it, where the system has such a thing."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

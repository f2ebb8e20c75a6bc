"""Count the CPU cores that this process may use."""

from __future__ import annotations

import os

SWITCH_INTERVAL = 0.0005
"""Interval (s) after which Python switches threads, for programs with deadlines; Python's default is 5 ms."""


def usable_cores() -> int:
    """Return the number of CPU cores that this process may use, according to its CPU affinity if the system has one."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

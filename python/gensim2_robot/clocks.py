"""Provide clocks for the control loop: the machine's clock, and a simulated clock that never sleeps."""

from __future__ import annotations

import contextlib
import gc
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from typing import Protocol

from gensim2.core.cores import SWITCH_INTERVAL

LOOP_PRIORITY = 50
"""Real-time priority of the control loop and of an arm's driver, the same as in ros2_control."""
CONTROLLER_PRIORITY = 40
"""Real-time priority of a controller process while the arm waits for it."""


class Clock(Protocol):
    """Interface of a clock. A clock tells the time and can suspend the caller until a given time."""

    def now(self) -> float:
        """Return the time of a monotonic clock, s."""
        ...

    def wait(self, until: float) -> None:
        """Wait until the given time; return at once if the time has passed."""
        ...

    def punctual(self) -> AbstractContextManager[str]:
        """Let this thread wake up promptly within the block. Yield the scheduling policy."""
        ...


class MachineClock:
    """The machine's monotonic clock, which shows the same time in all processes."""

    def now(self) -> float:
        return time.monotonic()

    def wait(self, until: float) -> None:
        time.sleep(max(0.0, until - time.monotonic()))

    @contextlib.contextmanager
    def punctual(self) -> Iterator[str]:
        """Let this thread run with as little delay as possible within the ``with`` block.

        The thread gets real-time priority if this is permitted (``ulimit -r``). Python threads switch at shorter
        intervals (``sys.setswitchinterval``). Garbage collection, which would take 0.1 s, skips the objects that exist
        at the start.

        Yields:
            The scheduling policy of the operating system: ``fifo`` with real-time priority, ``other`` without it.
        """
        before = sys.getswitchinterval()
        sys.setswitchinterval(SWITCH_INTERVAL)
        gc.freeze()
        scheduling = schedule_first(LOOP_PRIORITY)
        try:
            yield scheduling
        finally:
            if scheduling == "fifo":
                # SCHED_RESET_ON_FORK stays set, because only privileged processes may clear it.
                os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))
            gc.unfreeze()
            sys.setswitchinterval(before)


def schedule_first(priority: int) -> str:
    """Give this thread, but not its children, real-time priority if the operating system permits it.

    Args:
        priority: priority, 1 to 99.

    Returns:
        The resulting scheduling policy: ``fifo`` for real-time priority, else ``other``.
    """
    if not hasattr(os, "sched_setscheduler"):
        return "other"
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except PermissionError:
        return "other"
    return "fifo"


class SimulatedClock:
    """A clock that does not advance during computations, so that a run in one process is reproducible.

    Attributes:
        hooks: functions that the clock calls, in this order, with each new time.
    """

    def __init__(self) -> None:
        self._now = 0.0
        self.hooks: list[Callable[[float], None]] = []

    def now(self) -> float:
        return self._now

    def wait(self, until: float) -> None:
        if until > self._now:
            self._now = until
            for hook in self.hooks:
                hook(until)

    def punctual(self) -> AbstractContextManager[str]:
        """Do nothing, because a simulated clock is never late."""
        return contextlib.nullcontext("simulated")

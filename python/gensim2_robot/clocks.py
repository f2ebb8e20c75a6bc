"""The time that a line goes by: the machine's, or a simulated one that never sleeps."""

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
"""Of a loop, and of an arm's driver, that the kernel lets go before all others: that of ros2_control."""
CONTROLLER_PRIORITY = 40
"""Of a controller, for which the arm waits, in a process of its own."""


class Clock(Protocol):
    """Seconds, and waiting."""

    def now(self) -> float:
        """Seconds of a clock that never goes back."""
        ...

    def wait(self, until: float) -> None:
        """Return at that time; at once, if it is over."""
        ...

    def punctual(self) -> AbstractContextManager[str]:
        """Let the thread that waits be woken on time; gives the kernel's policy for it."""
        ...


class MachineClock:
    """The machine's monotonic clock, which all its processes share."""

    def now(self) -> float:
        """Seconds since the machine started."""
        return time.monotonic()

    def wait(self, until: float) -> None:
        """Sleep until then."""
        time.sleep(max(0.0, until - time.monotonic()))

    @contextlib.contextmanager
    def punctual(self) -> Iterator[str]:
        """Let nothing keep this thread from its turn while the block runs.

        It goes before all that is not real-time where the user may ask for that (``ulimit -r``), other threads give up
        the interpreter soon, and the garbage collector leaves alone what exists already: to look at all that was ever
        imported takes it 0.1 s.

        Yields:
            The policy by which the kernel schedules it: ``fifo``, or ``other`` where it is one among all.
        """
        before = sys.getswitchinterval()
        sys.setswitchinterval(SWITCH_INTERVAL)
        gc.freeze()
        scheduling = schedule_first(LOOP_PRIORITY)
        try:
            yield scheduling
        finally:
            if scheduling == "fifo":
                # The flag stays: only the privileged may take it back.
                os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))
            gc.unfreeze()
            sys.setswitchinterval(before)


def schedule_first(priority: int) -> str:
    """Schedule this thread, and none that it begins, before all that are not real-time, where the user may ask for it.

    Args:
        priority: among those that are, 1 to 99.

    Returns:
        The policy by which the kernel schedules it: ``fifo``, or ``other``.
    """
    if not hasattr(os, "sched_setscheduler"):
        return "other"
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except PermissionError:
        return "other"
    return "fifo"


class SimulatedClock:
    """A clock that stands still while anything is computed: one process, the same run every time.

    Attributes:
        hooks: called with each time that is reached, in order: what else goes by this clock.
    """

    def __init__(self) -> None:
        self._now = 0.0
        self.hooks: list[Callable[[float], None]] = []

    def now(self) -> float:
        """Seconds since it was made."""
        return self._now

    def wait(self, until: float) -> None:
        """Go on to that time."""
        if until > self._now:
            self._now = until
            for hook in self.hooks:
                hook(until)

    def punctual(self) -> AbstractContextManager[str]:
        """Nothing is late by it."""
        return contextlib.nullcontext("simulated")

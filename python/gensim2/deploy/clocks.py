"""The time that a line goes by: the machine's, or a simulated one that never sleeps."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol


class Clock(Protocol):
    """Seconds, and waiting."""

    def now(self) -> float:
        """Seconds of a clock that never goes back."""
        ...

    def wait(self, until: float) -> None:
        """Return at that time; at once, if it is over."""
        ...


class MachineClock:
    """The machine's monotonic clock, which all its processes share."""

    def now(self) -> float:
        """Seconds since the machine started."""
        return time.monotonic()

    def wait(self, until: float) -> None:
        """Sleep until then."""
        time.sleep(max(0.0, until - time.monotonic()))


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

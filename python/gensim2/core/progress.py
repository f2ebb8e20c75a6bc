"""Report the progress of long-running functions to a listener."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Self, TextIO

from gensim2.core.errors import printable

if TYPE_CHECKING:
    from rich.progress import TaskID


LINE_SECONDS = 30.0
"""Seconds between progress lines if the output is not a terminal."""


def clock(seconds: float) -> str:
    """Return a duration as hours, minutes and seconds, such as ``0:01:30``."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}"


def now() -> str:
    """Return the local time with its offset from UTC, such as ``2026-11-30T14:05:00+0100``."""
    return time.strftime("%Y-%m-%dT%H:%M:%S%z")


class Progress:
    """Listener to which a long function reports its progress, in stages; this base class ignores everything.

    Functions that take long have the argument ``progress: Progress = NULL_PROGRESS``. Workers report to the calling
    process.
    """

    def start(self, description: str, total: int | None = None) -> None:
        """Start a stage of ``total`` steps (None: unknown), and end the previous one."""

    def advance(self, steps: int = 1) -> None:
        """Report that ``steps`` more steps of the current stage are done."""

    def resize(self, total: int) -> None:
        """Change the number of steps of the current stage, for example because a time limit will end it earlier."""

    def message(self, text: str) -> None:
        """Show a line that stays visible."""

    def update(self, status: Any) -> None:
        """Show the :class:`~gensim2.data.status.Status` of a collection; called a few times a second at most."""


NULL_PROGRESS = Progress()


class NamedProgress(Progress):
    """Progress listener that forwards to another listener and puts a prefix before the description of each stage.

    Args:
        word: the prefix.
        progress: the other listener.
    """

    def __init__(self, word: str, progress: Progress) -> None:
        self._word, self._progress = word, progress

    def start(self, description: str, total: int | None = None) -> None:
        self._progress.start(f"{self._word}: {description}", total)

    def advance(self, steps: int = 1) -> None:
        self._progress.advance(steps)

    def resize(self, total: int) -> None:
        self._progress.resize(total)

    def message(self, text: str) -> None:
        self._progress.message(text)


class ConsoleProgress(Progress):
    """Progress listener that prints to standard error. On a terminal it shows progress bars; in a file or a pipe it
    prints a line every 30 s with an estimate of the remaining time, and one line at the end of each stage.

    Use it in a ``with`` block. The last stage ends with the block, also after an exception or Ctrl-C.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            SpinnerColumn,
            TextColumn,
            TimeElapsedColumn,
            TimeRemainingColumn,
        )
        from rich.progress import Progress as Bars

        self._console = Console(file=stream or sys.stderr, soft_wrap=True, highlight=False)
        self._bars = (
            Bars(
                SpinnerColumn(finished_text="[green]✓"),
                TextColumn("{task.description}"),
                BarColumn(bar_width=30),
                MofNCompleteColumn(),
                TimeElapsedColumn(),
                TimeRemainingColumn(),
                TextColumn("left"),
                console=self._console,
            )
            if self._console.is_terminal
            else None
        )
        self._stage: TaskID | None = None
        self._description: str | None = None
        self._done = 0
        self._total: int | None = None
        self._started = self._said = 0.0
        self._first: tuple[int, float] | None = None

    def __enter__(self) -> Self:
        if self._bars is not None:
            self._bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._finish()
        if self._bars is not None:
            self._bars.stop()

    @contextlib.contextmanager
    def paused(self) -> Iterator[None]:
        """Hide the bars during a block that prompts the user."""
        if self._bars is None:
            yield
            return
        self._bars.stop()
        try:
            yield
        finally:
            self._bars.start()

    def start(self, description: str, total: int | None = None) -> None:
        """Start a stage; the bar of the previous stage stays visible in its final state."""
        self._finish()
        self._description, self._done, self._total = printable(description), 0, total
        self._started = self._said = time.monotonic()
        self._first = None
        if self._bars is not None:
            from rich.markup import escape

            self._stage = self._bars.add_task(escape(self._description), total=total)

    def advance(self, steps: int = 1) -> None:
        self._done += steps
        if self._bars is not None and self._stage is not None:
            self._bars.advance(self._stage, steps)
        elif self._description is not None and steps:
            self._show_line(time.monotonic())

    def resize(self, total: int) -> None:
        self._total = total
        if self._bars is not None and self._stage is not None:
            self._bars.update(self._stage, total=total)

    def message(self, text: str) -> None:
        """Print a line above the bars."""
        self._console.print(printable(text), markup=False)

    def _show_line(self, now: float) -> None:
        """Print a line with the remaining time, unless the last line is recent."""
        if self._first is None:
            # The first step includes the start of the workers, so the estimate of the remaining time leaves it out.
            self._first = self._done, now
        if now - self._said < LINE_SECONDS or self._done == self._total:
            return
        self._said = now
        done, since = self._first
        left = ""
        if self._total is not None and self._done > done:
            left = f", about {clock((self._total - self._done) * (now - since) / (self._done - done))} left"
        self._console.print(f"{self._description}: {self._counted()}{left}", markup=False)

    def _counted(self) -> str:
        return f"{self._done}/{self._total}" if self._total is not None else f"{self._done}"

    def _finish(self) -> None:
        if self._description is None:
            return
        if self._bars is not None and self._stage is not None:
            self._bars.stop_task(self._stage)
        else:
            seconds = time.monotonic() - self._started
            self._console.print(f"{self._description}: {self._counted()} in {seconds:.1f} s", markup=False)
        self._description, self._stage = None, None

"""Questions to whoever carries trials out, at the terminal."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator, Sequence
from typing import Protocol

import click

from gensim2.core.progress import ConsoleProgress
from gensim2_robot.keys import Keys


class Person(Protocol):
    """Whoever lays out, and judges."""

    def lay_out(self, lines: Sequence[str]) -> None:
        """Return when everything stands where the lines say."""
        ...

    def judge(self, question: str, offered: bool | None) -> bool:
        """The answer to a question; ``offered``: what the simulator says."""
        ...

    def cause(self, causes: Sequence[str]) -> str:
        """Why it failed: one of the causes, or other words."""
        ...


class Terminal:
    """A person at the terminal, asked on standard error.

    Args:
        keys: that are let go of while a question is open.
        progress: that leaves the terminal alone meanwhile.
    """

    def __init__(self, keys: Keys, progress: ConsoleProgress) -> None:
        self._keys, self._progress = keys, progress

    def lay_out(self, lines: Sequence[str]) -> None:
        """Say what is to be laid out, and wait for Enter."""
        with self._asking():
            for line in lines:
                click.echo(line, err=True)
            click.prompt("Enter begins", default="", show_default=False, prompt_suffix=" ", err=True)

    def judge(self, question: str, offered: bool | None) -> bool:
        """Ask for yes or no; what the simulator says is the answer where none is typed."""
        says = "" if offered is None else f" (the simulator says {'yes' if offered else 'no'})"
        with self._asking():
            return click.confirm(f"{question}{says}", default=offered, err=True)

    def cause(self, causes: Sequence[str]) -> str:
        """Ask for a number of the list, or other words."""
        with self._asking():
            for number, cause in enumerate(causes, 1):
                click.echo(f"  {number}  {cause}", err=True)
            while True:
                said = str(click.prompt("Why: a number, or your own words", err=True)).strip()
                if not said.isdecimal():
                    return said
                if 1 <= int(said) <= len(causes):
                    return causes[int(said) - 1]

    @contextlib.contextmanager
    def _asking(self) -> Iterator[None]:
        """The terminal as it was before, and Ctrl-C at once: the arm stands by its own means meanwhile."""
        with self._progress.paused(), self._keys.let_go(), _interruptible():
            yield


@contextlib.contextmanager
def _interruptible() -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)

"""The keyboard of whoever stands by: r resumes, any other key stops."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import tty
from collections.abc import Iterator
from types import TracebackType
from typing import Self


class Keys:
    """Keys as they are pressed, where there is a terminal; none where there is not."""

    def __init__(self) -> None:
        self._there = sys.stdin is not None and sys.stdin.isatty()

    @property
    def is_there(self) -> bool:
        """Whether a person could press any."""
        return self._there

    def __enter__(self) -> Self:
        if self._there:
            self._before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._there:
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)

    @contextlib.contextmanager
    def let_go(self) -> Iterator[None]:
        """Give the terminal back while a block asks for whole lines."""
        if not self._there:
            yield
            return
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)
        try:
            yield
        finally:
            tty.setcbreak(sys.stdin)

    def pressed(self) -> str | None:
        """The next key; None: none was pressed."""
        if not self._there or not select.select([sys.stdin], [], [], 0.0)[0]:
            return None
        return os.read(sys.stdin.fileno(), 1).decode(errors="replace") or None

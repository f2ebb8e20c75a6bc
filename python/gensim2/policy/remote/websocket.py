"""Limit fragments and control frames of websockets, and shorten log messages."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from typing import Any

from gensim2.core.errors import one_line

CHUNK = 1 << 16
"""Number of bytes read at a time from an authenticated peer."""


def unfragmented(kind: Any, chunk: int = CHUNK, most: float = math.inf) -> Any:
    """Return a connection class that closes the connection on a fragmented message or too many control frames.

    Messages have a single frame. The websockets library limits the size of a message but not the number of its
    fragments, which could fill the memory. The library also answers every ping, even if the peer never reads the
    answers.

    Args:
        kind: ``ClientConnection`` or ``ServerConnection`` of ``websockets.sync``.
        chunk: number of bytes that are read and parsed at a time.
        most: maximum number of control frames from the peer. ``max_control_frames`` of a connection changes it.
    """
    from websockets.frames import DATA_OPCODES, Frame

    class Unfragmented(kind):  # type: ignore[misc]
        recv_bufsize = chunk
        max_control_frames, control_frames = most, 0
        dropped = False

        def process_event(self, event: Any) -> None:
            is_data = isinstance(event, Frame) and event.opcode in DATA_OPCODES
            if isinstance(event, Frame) and not is_data:
                self.control_frames += 1
            if self.control_frames > self.max_control_frames or (is_data and not event.fin):
                self.dropped = True
                self.close_socket()
            # One received chunk may contain further frames after the frame that closed the connection. Ignore them.
            elif not self.dropped:
                super().process_event(event)

    return Unfragmented


class _Lines(logging.Handler):
    """Shortens each log message of the websockets library to one line, without a traceback."""

    def __init__(self, said: Callable[[str], None]) -> None:
        super().__init__(logging.ERROR)
        self._said = said

    def emit(self, record: logging.LogRecord) -> None:
        error = record.exc_info[1] if record.exc_info else None
        # Reading from a connection that the library has just closed is harmless.
        if isinstance(error, EOFError):
            return
        self._said(one_line(record.getMessage() if error is None else f"{record.getMessage()}: {error}"))


def logger(said: Callable[[str], None] = lambda line: None) -> logging.Logger:
    """Return a logger for one connection.

    Args:
        said: callback that gets each error as one line of text.
    """
    found = logging.Logger("websockets", logging.ERROR)
    found.addHandler(_Lines(said))
    return found

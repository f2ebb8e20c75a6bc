"""An end of a pipe between processes that never waits: for whoever must not stop because the other process has."""

from __future__ import annotations

import os
import pickle
import struct
from collections import deque
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler
from typing import Any

from gensim2.core.errors import GenSim2Error

MAX_WAITING = 500
"""Messages that may wait for a process that reads nothing, beside those that the kernel holds: the loop sends 100 a
second."""
CHUNK = 1 << 16
MAX_CHUNKS = 256
"""Bytes, and number of reads, of one look at what came: a flood does not keep whoever looks."""
_LENGTH = struct.Struct("!i")
_LONG = struct.Struct("!Q")


class DeviceGoneError(GenSim2Error):
    """A device's process has ended, or does not answer."""


class MessagePipe:
    """The end that never waits; the other end may be a plain ``Connection``.

    The system call of a blocking ``Connection`` waits for ever once the other process is stopped: ``send`` when the
    kernel's buffer is full, ``recv`` in the middle of a message.

    Args:
        connection: this end.
        what: is at the other end, for error messages.
    """

    def __init__(self, connection: Connection, what: str) -> None:
        self._connection, self._what = connection, what
        os.set_blocking(connection.fileno(), False)
        self._came = bytearray()
        self._going: deque[memoryview] = deque()
        self._is_over = self._is_stuck = False

    def tell(self, message: Any) -> None:
        """Send a message; what cannot be sent shows at the next :meth:`drain`."""
        if self._is_over or self._is_stuck:
            return
        if len(self._going) >= MAX_WAITING:
            self._is_stuck = True
            return
        data = bytes(ForkingPickler.dumps(message))
        head = _LENGTH.pack(len(data)) if len(data) < 1 << 31 else _LENGTH.pack(-1) + _LONG.pack(len(data))
        self._going.append(memoryview(head + data))
        self._flush()

    def drain(self) -> list[Any]:
        """Return the messages that came whole.

        Raises:
            DeviceGoneError: the other process has ended, or does not read what it is sent.
        """
        self._flush()
        self._read()
        if self._is_stuck:
            raise DeviceGoneError(f"the process of the {self._what} does not answer")
        found = []
        while (message := self._next()) is not None:
            found.append(pickle.loads(message))  # of a process that this one has started
        if not found and self._is_over:
            raise DeviceGoneError(f"the process of the {self._what} is gone")
        return found

    def close(self) -> None:
        """Close this end."""
        self._is_over = True
        self._connection.close()

    def _flush(self) -> None:
        try:
            while self._going and not self._is_over:
                sent = os.write(self._connection.fileno(), self._going[0])
                if sent < len(self._going[0]):
                    self._going[0] = self._going[0][sent:]
                else:
                    self._going.popleft()
        except BlockingIOError:
            return
        except OSError:  # it has ended: what it said before is still read
            self._going.clear()

    def _read(self) -> None:
        try:
            for _ in range(0 if self._is_over else MAX_CHUNKS):
                data = os.read(self._connection.fileno(), CHUNK)
                self._came += data
                if not data:
                    self._is_over = True
                    return
        except BlockingIOError:
            return
        except OSError:
            self._is_over = True

    def _next(self) -> bytes | None:
        """Return the next message, if it is there whole."""
        if len(self._came) < _LENGTH.size:
            return None
        (length,), begin = _LENGTH.unpack_from(self._came), _LENGTH.size
        if length == -1:
            if len(self._came) < begin + _LONG.size:
                return None
            (length,), begin = _LONG.unpack_from(self._came, begin), begin + _LONG.size
        if len(self._came) < begin + length:
            return None
        found = bytes(self._came[begin : begin + length])
        del self._came[: begin + length]
        return found

"""Whether the head of a Ray cluster is there: Ray itself ends the whole process, with 1, a minute after it is not."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable

LOOK_SECONDS = 1.0
"""Between two looks."""

GONE_SECONDS = 15.0
"""Without an answer, after which it counts as gone; Ray waits 60 (``gcs_rpc_server_reconnect_timeout_s``)."""

CONNECT_SECONDS = 5.0

left_waiting = False
"""Whether Ray was left while it waits for a head that is gone: its threads end this process with codes of their own."""


class Head:
    """The head of a cluster, asked by no more than a connection: Ray's own questions wait for what is not there.

    Args:
        address: ``HOST:PORT`` of its control service.
    """

    def __init__(self, address: str) -> None:
        host, _, port = address.rpartition(":")
        self.address = address
        self._where = (host.strip("[]"), int(port))
        self._looked = 0.0
        self._answered = time.monotonic()
        self.is_there = True

    def look(self) -> bool:
        """Return whether it took a connection at the last look, at most ``LOOK_SECONDS`` ago."""
        now = time.monotonic()
        if now - self._looked > LOOK_SECONDS:
            self._looked = now
            try:
                socket.create_connection(self._where, CONNECT_SECONDS).close()
                self.is_there, self._answered = True, time.monotonic()
            except OSError:
                self.is_there = False
        return self.is_there

    @property
    def is_gone(self) -> bool:
        """Whether it has not answered for so long that it counts as gone."""
        return not self.is_there and time.monotonic() - self._answered > GONE_SECONDS


class Latest:
    """An answer of Ray's that may never come, asked for beside the work.

    Args:
        ask: gives it; the first is waited for.
    """

    def __init__(self, ask: Callable[[], int]) -> None:
        self._ask = ask
        self._thread: threading.Thread | None = None
        self.value = ask()

    def renew(self) -> None:
        """Ask anew, where the question before has been answered."""
        if self._thread is None or not self._thread.is_alive():
            self._thread = threading.Thread(target=self._renewed, daemon=True)
            self._thread.start()

    def _renewed(self) -> None:
        self.value = self._ask()

"""Whether a Ray head is alive, tested with a plain socket."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable

import pytest

from gensim2.core.processes import ray
from gensim2.core.processes.ray import Head


def _soon(condition: Callable[[], bool]) -> bool:
    deadline = time.monotonic() + 30
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.01)
    return condition()


def test_a_head_is_gone_once_it_has_not_answered_for_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ray, "RETRY_SECONDS", 0.02)
    monkeypatch.setattr(ray, "GONE_SECONDS", 0.6)
    with socket.create_server(("127.0.0.1", 0)) as server:
        head = Head(f"127.0.0.1:{server.getsockname()[1]}")
        connection, _ = server.accept()
        connection.close()  # as a server closes a silent connection
        connection, _ = server.accept()
        assert head.is_there
    connection.close()
    assert _soon(lambda: not head.is_there)
    assert not head.is_gone  # it may come back
    assert _soon(lambda: head.is_gone)
    assert not head.is_there

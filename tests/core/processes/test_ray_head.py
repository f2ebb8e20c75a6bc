"""Whether a head is there, asked of a socket in the place of Ray's."""

from __future__ import annotations

import socket
import threading
import time

import pytest

from gensim2.core.processes import ray_head
from gensim2.core.processes.ray_head import Head, Latest


def test_a_head_is_gone_once_it_has_not_answered_for_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ray_head, "LOOK_SECONDS", 0.0)
    monkeypatch.setattr(ray_head, "GONE_SECONDS", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as server:
        head = Head(f"127.0.0.1:{server.getsockname()[1]}")
        assert head.look()
        assert not head.is_gone
    assert not head.look()
    assert not head.is_gone  # it may come back
    time.sleep(0.4)
    assert not head.look()
    assert head.is_gone


def test_a_question_that_is_never_answered_holds_up_nobody() -> None:
    asked, answer = [0], threading.Event()

    def ask() -> int:
        asked[0] += 1
        if asked[0] > 1:
            answer.wait(60)
        return asked[0]

    latest = Latest(ask)
    for _ in range(3):
        latest.renew()
    assert latest.value == 1
    assert asked[0] <= 2
    answer.set()
    deadline = time.monotonic() + 30
    while latest.value != 2 and time.monotonic() < deadline:
        time.sleep(0.01)
    assert latest.value == 2

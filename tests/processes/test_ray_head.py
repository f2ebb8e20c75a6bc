"""Whether a head is there, asked of a socket in the place of Ray's."""

from __future__ import annotations

import socket
import time

import pytest

from gensim2.processes import ray_head
from gensim2.processes.ray_head import Head


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

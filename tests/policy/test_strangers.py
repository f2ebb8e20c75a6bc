"""Untrusted peers at both ends of the websocket get few bytes, few values and little time."""

from __future__ import annotations

import contextlib
import re
import socket
import threading
import time
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect
from websockets.sync.server import serve

from gensim2.perception import ObservationSpec
from gensim2.policy.remote import protocol, server
from gensim2.policy.remote.client import RemoteController
from gensim2.policy.remote.protocol import MAX_BYTES, RemoteError, decode, encode
from gensim2.policy.remote.server import PolicyServer
from gensim2.rollout.controller_spec import ControllerSpec
from policy.test_remote import TOKEN, observation

LARGEST = b"\xdd" + (MAX_BYTES - 5).to_bytes(4, "big") + b"\x80" * (MAX_BYTES - 5)
"""As many empty maps as fit into a message: 1.2 GB after decoding."""


@pytest.fixture
def serving(monkeypatch: pytest.MonkeyPatch) -> Iterator[PolicyServer]:
    monkeypatch.setenv(protocol.TOKEN, TOKEN)
    found = PolicyServer(ControllerSpec(f"{Path(__file__).with_name('test_remote.py')}:Echo"), "panda", TOKEN, port=0)
    threading.Thread(target=found.serve, daemon=True).start()
    yield found
    found.close()


def highest_memory() -> int:
    """Return the highest memory (bytes) of this process since the last call."""
    found = re.search(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text())
    assert found is not None
    Path("/proc/self/clear_refs").write_text("5")
    return 1024 * int(found[1])


# --- the server


def test_strangers_neither_fill_the_memory_nor_delay_the_loop(serving: PolicyServer) -> None:
    controller = RemoteController(serving.url, deadline=30.0)
    over = threading.Event()

    def attack() -> None:
        while not over.is_set():
            with contextlib.suppress(OSError, WebSocketException), connect(serving.url, compression=None) as stranger:
                stranger.send(LARGEST)
                stranger.recv(timeout=5.0)

    highest_memory()
    before = highest_memory()
    strangers = [threading.Thread(target=attack) for _ in range(4)]
    for each in strangers:
        each.start()
    delays = []
    for step in range(30):
        begun = time.monotonic()
        controller.act(observation(step))
        delays.append(time.monotonic() - begun)
        time.sleep(0.05)
    over.set()
    for each in strangers:
        each.join()
    controller.close()
    assert highest_memory() - before < 400 << 20, "most of it is what the strangers' own threads mask and send"
    assert np.median(delays) < 0.15


def test_no_more_than_a_few_strangers_at_a_time_and_for_seconds(
    serving: PolicyServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "GREETING", 1.0)
    served = RemoteController(serving.url, deadline=30.0)
    silent = [connect(serving.url) for _ in range(server.MAX_STRANGERS)]
    with pytest.raises((OSError, WebSocketException)):
        connect(serving.url)
    assert served.act(observation(0)) is not None, "whoever has said the token is none of them"
    served.close()
    begun = time.monotonic()
    for each in silent:
        with pytest.raises(WebSocketException):
            each.recv(timeout=20.0)
    assert time.monotonic() - begun < 10.0
    RemoteController(serving.url).close()


def test_a_message_in_fragments_is_refused_at_once(serving: PolicyServer) -> None:
    with connect(serving.url) as stranger:
        begun = time.monotonic()
        with contextlib.suppress(WebSocketException):
            stranger.send(iter([b"a", b"b"]))
        with pytest.raises(WebSocketException):
            stranger.recv(timeout=20.0)
    assert time.monotonic() - begun < server.GREETING
    RemoteController(serving.url).close()


def test_a_stranger_that_speaks_no_websocket_leaves_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setenv(protocol.TOKEN, TOKEN)
    spec = ControllerSpec(f"{Path(__file__).with_name('test_remote.py')}:Echo")
    found = PolicyServer(spec, "panda", TOKEN, port=0, said=said.append)
    threading.Thread(target=found.serve, daemon=True).start()
    with socket.create_connection((found.host, found.port)) as stranger:
        stranger.sendall(b"\x16\x03\x01 no HTTP\r\n\r\n")
        stranger.settimeout(20.0)
        while stranger.recv(4096):
            pass
    until = time.monotonic() + 10.0
    while not said and time.monotonic() < until:
        time.sleep(0.01)
    found.close()
    assert len(said) == 1
    assert "handshake failed" in said[0]
    assert len(said[0].splitlines()) == 1


@pytest.mark.parametrize(
    "data",
    [
        LARGEST,
        b"\x91" * 100_000,
        b"\x91" * 900 + b"\xc0",
        b"\x82\xa4kind\xa1x\xa4kind\xa1y",
        b"\x81\xa4kind\xc7\x01\x05\x00",
        encode({"kind": "x", "lists": [list(range(900))] * 20}),
        encode({"kind": "x", "text": "x" * 100_000}),
        encode({"kind": "x", "a": {"__array__": ["float32", [2**40, 0], b""]}}),
        encode({"kind": "x", "a": {"__array__": ["object", [1], b"\0" * 8]}}),
        encode({"kind": "x", "a": {"__array__": 5}}),
        encode({"kind": "x", "a": {"__array__": ["float32", [True], b"\0" * 4]}}),
    ],
)
def test_values_are_counted_as_they_are_decoded(data: bytes) -> None:
    tracemalloc.start()
    with pytest.raises(RemoteError):
        decode(data)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 4 << 20


# --- the client

SPEC = ObservationSpec(modalities=()).to_dict()
WELCOME = {
    "kind": "welcome",
    "protocol": protocol.VERSION,
    "gensim2": "0",
    "controller": "mine.py:Policy",
    "robot": "panda",
    "action_size": 8,
    "observation": SPEC,
}
READY = {"kind": "ready", "number": 1, "observation": SPEC}
ACTION = {"kind": "action", "number": 1, "action": np.zeros(8, np.float32), "observation": SPEC}

Answers = Callable[[bytes], list[Any]]


@pytest.fixture
def hostile(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., str]]:
    """Yield a function that starts servers with arbitrary answers and returns their addresses."""
    monkeypatch.setenv(protocol.TOKEN, TOKEN)
    servers = []

    def start(*answers: Any) -> str:
        def handle(connection: Any) -> None:
            with contextlib.suppress(WebSocketException):
                for answer in answers:
                    connection.recv()
                    data = answer if not isinstance(answer, dict) else encode(answer)
                    connection.send(data)
                connection.recv()

        found = serve(handle, "127.0.0.1", 0, compression=None)
        threading.Thread(target=found.serve_forever, daemon=True).start()
        servers.append(found)
        return f"ws://127.0.0.1:{found.socket.getsockname()[1]}"

    yield start
    for each in servers:
        each.shutdown()


def spec(**changed: Any) -> dict[str, Any]:
    return {**SPEC, **changed}


@pytest.mark.parametrize(
    ("welcome", "said"),
    [
        ({"observation": spec(modalities=5)}, "invalid observation spec: modalities must be a list of names, got 5"),
        ({"observation": spec(modalities=[5])}, r"spec: modalities must be a list of names, got \[5\]"),
        ({"observation": spec(cameras=None)}, "spec: cameras must be a list of names, got None"),
        ({"observation": spec(cameras=[])}, "spec: cameras must be a list of"),
        ({"observation": spec(cloud=5)}, "spec: cloud must be a mapping, got 5"),
        ({"observation": spec(cloud={"low": 5})}, "spec: low must be three numbers"),
        ({"observation": spec(cloud={"low": ["a", "b", "c"]})}, "spec: low must be three numbers"),
        ({"observation": spec(cloud={"noise": 5})}, "spec: noise must be a mapping, got 5"),
        ({"observation": spec(cloud={"noise": {"lost": "x"}})}, "spec: noise.lost must be a number"),
        ({"observation": spec(cloud={"outliers": "x"})}, "spec: outliers must be a number, got 'x'"),
        ({"observation": spec(cloud={"robot": [1]})}, r"spec: robot must be one of .*, got \[1\]"),
        ({"observation": spec(cloud={"points": float("nan")})}, "spec: points must be a whole number .*, got nan"),
        ({"observation": None}, "invalid welcome message: observation: input should be a valid dict"),
        ({"action_size": -1}, "invalid welcome message: action_size: input should be greater"),
        ({"robot": "fetch"}, "serves the robot fetch, but this robot is panda"),
        ({"more": 1}, "invalid welcome message: more: unknown field"),
        ({"kind": "ready"}, "sent the message 'ready' instead of welcome or refused"),
        ({"kind": [[[[1]]]]}, "without a kind"),
        ({"protocol": [1]}, r"uses protocol version \[1\]"),
    ],
)
def test_a_welcome_is_checked_by_its_schema(hostile: Callable[..., str], welcome: dict[str, Any], said: str) -> None:
    url = hostile({**WELCOME, **welcome})
    with pytest.raises(RemoteError, match=said) as found:
        RemoteController(url, "panda")
    assert url in str(found.value)
    assert len(str(found.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (READY, "sent the message 'ready' instead of action or error"),
        (WELCOME, "sent the message 'welcome' instead of action or error"),
        (
            {**ACTION, "action": np.full(8, np.nan, np.float32)},
            "action: must contain only finite numbers, but contains NaN or infinity",
        ),
        ({**ACTION, "action": np.zeros((2, 8), np.float32)}, r"action: must be an array of shape \(N\), got \(2, 8\)"),
        ({**ACTION, "action": np.zeros(7, np.float32)}, r"action must be an array of shape \(8,\), got \(7,\)"),
        ({**ACTION, "action": [0.0] * 8}, "action: must be an array of float32"),
        ({**ACTION, "action": np.full(8, 1e60)}, "action: must be an array of float32"),
        ({**ACTION, "action": np.zeros(8, bool)}, "action: must be an array of float32"),
        ({**ACTION, "number": 2}, "answered request 2, but the last request was 1"),
        ({**ACTION, "number": True}, "number: input should be a valid integer"),
        ({"kind": "action", "number": 1, "observation": SPEC}, "action: field required"),
        ({**ACTION, "observation": spec(modalities=5)}, "modalities must be a list of names, got 5"),
        (b"\xdd\x00\x00\xf0\x00" + b"\x80" * 60_000, "damaged message"),
        ("text", "a text message, but must send a binary message"),
    ],
)
def test_an_answer_is_checked_by_the_schema_of_its_request(hostile: Callable[..., str], answer: Any, said: str) -> None:
    url = hostile(WELCOME, answer)
    controller = RemoteController(url, "panda", deadline=10.0)
    with pytest.raises(RemoteError, match=said) as found:
        controller.act(observation(0))
    assert url in str(found.value)
    controller.close()


@pytest.mark.parametrize("answer", [bytes(protocol.MAX_ANSWER + 1), iter([b"a", b"b"])])
def test_an_answer_that_is_too_large_or_in_fragments_ends_the_connection(
    hostile: Callable[..., str], answer: Any
) -> None:
    controller = RemoteController(hostile(WELCOME, answer), deadline=10.0)
    with pytest.raises(RemoteError, match="is no longer reachable"):
        controller.act(observation(0))


def test_a_server_that_repeats_old_answers_for_ever_is_late(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(protocol.TOKEN, TOKEN)

    def handle(connection: Any) -> None:
        connection.recv()
        connection.send(encode(WELCOME))
        connection.recv()
        connection.send(encode(READY))
        old = encode(READY)
        with contextlib.suppress(WebSocketException):
            while True:
                connection.send(old)

    with serve(handle, "127.0.0.1", 0, compression=None) as found:
        threading.Thread(target=found.serve_forever, daemon=True).start()
        url = f"ws://127.0.0.1:{found.socket.getsockname()[1]}"
        controller = RemoteController(url, deadline=0.5)
        controller.reset(observation(0), 0)
        begun = time.monotonic()
        with pytest.raises(RemoteError, match="no answer within 500 ms"):
            controller.act(observation(0))
        assert time.monotonic() - begun < 5.0
        controller.close()


def test_a_server_that_reads_nothing_is_late(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(protocol.TOKEN, TOKEN)
    over = threading.Event()

    def handle(connection: Any) -> None:
        connection.recv()
        connection.send(encode(WELCOME))
        connection.recv_flow_control.acquire()  # stops reading from the socket
        over.wait(30.0)
        connection.recv_flow_control.release()

    with serve(handle, "127.0.0.1", 0, compression=None) as found:
        threading.Thread(target=found.serve_forever, daemon=True).start()
        controller = RemoteController(f"ws://127.0.0.1:{found.socket.getsockname()[1]}", deadline=0.5)
        begun = time.monotonic()
        for _ in range(2):
            with pytest.raises(
                RemoteError, match=r"no answer within|is no longer reachable|was interrupted|cannot be reached"
            ):
                controller.act(observation(0, points=900_000))
            if time.monotonic() - begun > 5.0:
                break
        controller.close()
        assert time.monotonic() - begun < 8.0
        over.set()


def test_a_controller_that_gives_no_action_is_told_to_its_loop(serving: PolicyServer) -> None:
    controller = RemoteController(serving.url, deadline=10.0)
    serving._controller.act = lambda seen: np.full(8, np.inf)  # type: ignore[method-assign]
    with pytest.raises(RemoteError, match="NaN or infinity"):
        controller.act(observation(0))
    serving._controller.act = lambda seen: np.zeros(3)  # type: ignore[method-assign]
    with pytest.raises(RemoteError, match=r"an action of shape \(3,\)"):
        controller.act(observation(0))
    controller.close()


def permits(serving: PolicyServer) -> int:
    """Return how many unauthenticated clients a server would accept now."""
    found = 0
    while serving._strangers.acquire(blocking=False):
        found += 1
    for _ in range(found):
        serving._strangers.release()
    return found


OPENING = (
    b"GET / HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n"
)
PINGS = (b"\x89\xfd\0\0\0\0" + bytes(125)) * 1000
"""Ping frames, each of which gets an answer of the same size."""


@pytest.mark.parametrize("frames", [None, 10**9])
def test_strangers_that_ping_and_read_nothing_are_gone_in_seconds(
    monkeypatch: pytest.MonkeyPatch, frames: int | None
) -> None:
    """Limited are both the number of their frames and the time that an answer may wait."""
    monkeypatch.setattr(server, "GREETING", 1.0)
    if frames is not None:
        monkeypatch.setattr(server, "MAX_CONTROL_FRAMES", frames, raising=False)
    spec = ControllerSpec(f"{Path(__file__).with_name('test_remote.py')}:Echo")
    found = PolicyServer(spec, "panda", TOKEN, port=0)
    threading.Thread(target=found.serve, daemon=True).start()
    with contextlib.ExitStack() as stack:
        stack.callback(found.close)
        for _ in range(server.MAX_STRANGERS):
            stranger = stack.enter_context(socket.create_connection((found.host, found.port)))
            stranger.sendall(OPENING)
            stranger.settimeout(0.5)
            with contextlib.suppress(OSError):
                for _ in range(500):
                    stranger.sendall(PINGS)
        until = time.monotonic() + 20.0
        while permits(found) < server.MAX_STRANGERS and time.monotonic() < until:
            time.sleep(0.05)
        assert permits(found) == server.MAX_STRANGERS


def test_strangers_are_counted_by_connection_and_not_by_address(serving: PolicyServer) -> None:
    served = RemoteController(serving.url, deadline=30.0)
    address = served._connection.socket.getsockname()
    serving._speak = lambda peer, address: None
    ours, theirs = socket.socketpair()
    with ours, theirs:
        serving._admit(theirs, address)
    assert permits(serving) == server.MAX_STRANGERS
    served.close()


def test_an_assertion_of_the_websockets_library_is_an_error_of_one_line(
    hostile: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The library asserts an internal state if a server sends garbage at the same moment as the client's request."""
    from websockets.sync.client import ClientConnection

    def fail(*_: Any) -> None:
        raise AssertionError

    monkeypatch.setattr(ClientConnection, "handshake", fail)
    with pytest.raises(RemoteError, match="cannot be reached: the server did not send a valid HTTP response"):
        RemoteController(hostile(), "panda")


def test_a_client_whose_process_ends_has_just_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setenv(protocol.TOKEN, TOKEN)
    spec = ControllerSpec(f"{Path(__file__).with_name('test_remote.py')}:Echo")
    found = PolicyServer(spec, "panda", TOKEN, port=0, said=said.append)
    threading.Thread(target=found.serve, daemon=True).start()
    client = RemoteController(found.url)
    client._connection.close_socket()
    until = time.monotonic() + 10.0
    while len(said) < 2 and time.monotonic() < until:
        time.sleep(0.01)
    found.close()
    assert said == ["127.0.0.1 connected", "127.0.0.1 gone"]

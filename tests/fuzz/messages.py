"""Send hostile messages between a control loop and a policy server, at random by a seed, through real websockets.

``python tests/fuzz/messages.py --inputs 5000`` sends 5,000 first messages to a server, 5,000 requests after
authentication, and lets a server give 5,000 answers to a client. They are mutations of valid messages and hand-made
ones. Each is tried in a forked process with 1 GiB of memory and 5 s of CPU, and must be read correctly or refused in
one line.
"""

from __future__ import annotations

import os
import pickle
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
from mutate import check_line, damaged, damaged_value
from runner import CANARY, Ended, Say, Tally, in_process, main, tried
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect
from websockets.sync.server import serve

from gensim2.perception import Camera, DepthNoise, Observation, ObservationSpec, PointCloud
from gensim2.perception.observation import STATE, VELOCITY
from gensim2.policy.remote import client, server
from gensim2.policy.remote.client import RemoteController
from gensim2.policy.remote.protocol import (
    MAX_BYTES,
    TOKEN,
    VERSION,
    RemoteError,
    decode,
    encode,
    observation_to_message,
)
from gensim2.policy.remote.server import PolicyServer
from gensim2.policy.remote.websocket import logger
from gensim2.rollout.controller_spec import ControllerSpec

SECRET = "a token of no worth"
DEADLINE = 5.0

#: What a message may name in the place of a word; none of it may be loaded.
NAMES = ("canary", "canary:robot", "canary.py", "canary.py:Policy", "./canary.py", "__import__('canary')")

SEEN = Observation(0, 0.0, "", {STATE: np.zeros(9, "f4"), VELOCITY: np.zeros(9, "f4")}, None, {})
SPECS = (
    ObservationSpec(modalities=()).to_dict(),
    ObservationSpec(modalities=("rgb", "depth"), cameras=("left",)).to_dict(),
    ObservationSpec.of({"points": 256, "noise": DepthNoise()}).to_dict(),
)
ACTION = np.linspace(-1.0, 1.0, 8, dtype=np.float32)
HELLO = {"kind": "hello", "protocol": VERSION, "token": SECRET, "robot": "panda"}
WELCOME = {
    "kind": "welcome",
    "protocol": VERSION,
    "gensim2": "0.2",
    "controller": "mine.py:Policy",
    "robot": "panda",
    "action_size": 8,
    "observation": SPECS[0],
}
CAMERA = Camera("left", 4, 3, np.eye(3), np.eye(4))
CLOUD = PointCloud(np.ones((5, 3), "f4"), np.zeros((5, 3), "u1"), np.zeros(5, "i4"))
REQUESTS: tuple[dict[str, Any], ...] = tuple(
    {"number": 1, **kind, "observation": observation_to_message(seen)}
    for kind in ({"kind": "act"}, {"kind": "reset", "seed": 3})
    for seen in (SEEN, replace(SEEN, language="close the box", cloud=CLOUD, cameras={"left": CAMERA}))
)
ANSWERS: tuple[dict[str, Any], ...] = tuple(
    answer
    for spec in SPECS
    for answer in (
        {**WELCOME, "observation": spec},
        {"kind": "ready", "number": 1, "observation": spec},
        {"kind": "action", "number": 1, "action": ACTION, "observation": spec},
        {"kind": "error", "number": 1, "why": "the controller failed"},
    )
)


def handmade(good: Mapping[str, Any], generator: np.random.Generator) -> bytes | str | list[bytes]:
    """Return a hand-made hostile message that mutations would hardly find; texts and fragments are sent as such."""
    count = int(generator.choice([0, 1, 1000, 65_535, 2**31 - 1, 2**32 - 1]))
    size = int(generator.choice([1, 1000, 4096, 70_000, MAX_BYTES]))
    ways: tuple[Callable[[], bytes | str | list[bytes]], ...] = (
        lambda: b"",
        lambda: "text" * 100,
        lambda: msgpack.packb(dict(good), default=str).decode("latin1"),
        lambda: [encode(good)[:5], encode(good)[5:]],
        lambda: [b""] * 2000 + [encode(good)],
        lambda: encode(good) * 2,
        lambda: encode(good) + b"\xc0",
        lambda: b"\xdd" + count.to_bytes(4, "big") + b"\x80" * size,
        lambda: b"\xdf" + count.to_bytes(4, "big") + b"\xa0\x80" * (size // 2),
        lambda: b"\xdb" + count.to_bytes(4, "big") + b"x" * size,
        lambda: b"\xc6" + count.to_bytes(4, "big") + bytes(size),
        lambda: b"\xc9" + count.to_bytes(4, "big") + b"\x05" + bytes(size),
        lambda: bytes([int(generator.choice([0x91, 0x81, 0x92, 0xDC]))]) * size,
        lambda: b"\x81\xa4kind" * min(size, 900) + b"\xc0",
        lambda: b"\x81\xa4kind\xd6\xff" + bytes(4),
        lambda: b"\x81\xc0\xa1x",
        lambda: b"\x81\x01\xa1x",
        lambda: b"\x81\xc4\x04kind\xa5hello",
        lambda: b"\x82\xa4kind\xa5hello\xa4kind\xa7welcome",
        lambda: b"\x81\xa4kind\xa4\xff\xfe\xed\xa0",
        lambda: msgpack.packb({**_packable(good), "more": [[0] * 900] * 100}),
        lambda: msgpack.packb({**_packable(good), "kind": _named(generator)}),
        lambda: msgpack.packb({**_packable(good), "kind": ["hello"] * 3}),
        lambda: msgpack.packb({**_packable(good), "number": 2**63 + 5}),
        lambda: msgpack.packb({**_packable(good), "number": float("nan")}),
        lambda: msgpack.packb({**_packable(good), "protocol": _deep(900)}),
        lambda: msgpack.packb({**_packable(good), "robot": _named(generator), "controller": _named(generator)}),
        lambda: msgpack.packb({**_packable(good), "action": {"__array__": _hostile_array(generator)}}),
        lambda: msgpack.packb({**_packable(good), "token": {"__array__": _hostile_array(generator)}}),
        lambda: msgpack.packb({**_packable(good), "observation": {"cloud": {"noise": _deep(500)}}}),
        lambda: msgpack.packb({**_packable(good), "observation": {"modalities": "a\nb\x1b[31m" * 20}}),
        lambda: msgpack.packb({**_packable(good), "why": "<script>" + "a\nb" * 600}),
        lambda: pickle.dumps(good),
    )
    return ways[int(generator.integers(len(ways)))]()


def _named(generator: np.random.Generator) -> str:
    return NAMES[int(generator.integers(len(NAMES)))]


def _deep(levels: int) -> Any:
    found: Any = None
    for _ in range(levels):
        found = [found]
    return found


def _hostile_array(generator: np.random.Generator) -> list[Any]:
    kinds = ("float32", "object", "O", "V8", "<f4", "float64", "bool", "int64", "canary", "")
    shapes: tuple[Any, ...] = ([8], [2**62], [0, 2**40], [-1], [True], [1] * 60, 8, ["8"], [], [2, 4], None, [2**63])
    values = (bytes(32), b"", b"\xff" * 32, bytes(33), "x" * 32, None, [0.0] * 8, bytes(4))
    draw = [chosen[int(generator.integers(len(chosen)))] for chosen in (kinds, shapes, values)]
    return draw[: int(generator.choice([3, 3, 3, 2]))]


def _packable(value: Any) -> Any:
    """Return a message with its arrays in the form in which they are sent."""
    return msgpack.unpackb(encode(value), strict_map_key=False)


def hostile(good: Mapping[str, Any], generator: np.random.Generator) -> bytes | str | list[bytes]:
    """Return one hostile message."""
    if generator.random() < 0.25:
        return handmade(good, generator)
    if generator.random() < 0.15:
        return encode(_nearly(good, generator))
    data = encode(good)
    if generator.random() < 0.25:
        return damaged(data, "binary", generator)
    value = _packable(good)
    for _ in range(int(generator.integers(1, 3))):
        value = damaged_value(value, generator)
        if generator.random() < 0.1 and isinstance(value, dict) and value:
            value[list(value)[int(generator.integers(len(value)))]] = _named(generator)
    try:
        packed: bytes = msgpack.packb(value)
    except (ValueError, TypeError, OverflowError):  # values that messages cannot contain
        return damaged(data, "binary", generator)
    return packed


def _nearly(good: Mapping[str, Any], generator: np.random.Generator) -> dict[str, Any]:
    """Return a message whose fields have the right types; most are valid, with other values."""
    action = ACTION * 10.0 ** generator.integers(-60, 60)
    fields: dict[str, tuple[Any, ...]] = {
        "robot": (None, "panda", "fetch", _named(generator)),
        "token": (SECRET, SECRET[:-1], SECRET + " "),
        "protocol": (VERSION, VERSION + 1),
        "number": (1, 0, 2),
        "action_size": (8, 7),
        "action": (None, action, action.astype(np.float64), action[:7], np.append(ACTION[:7], np.inf), ACTION[:, None]),
        "observation": (*SPECS, {}, {"modalities": "rgb"}, {"cloud": None}, {"points": 64}),
        "why": ("", "a", "x" * 3000),
        "seed": (0, -1, -(2**63), 1.0),
    }
    return {
        name: fields[name][int(generator.integers(len(fields[name])))]
        if name in fields and generator.random() < 0.5
        else value
        for name, value in good.items()
    }


# --------------------------------------------------------------------------------------------- attempts


class Still:
    """A controller that does nothing but keep its last observation."""

    observation_spec = ObservationSpec(modalities=())
    shown: Observation | None = None

    def reset(self, observation: Observation, seed: int) -> None:
        Still.shown = observation

    def act(self, observation: Observation) -> Any:
        """Return always the same action."""
        Still.shown = observation
        return ACTION


def try_first(message: bytes | str | list[bytes]) -> str:
    """Send a first message to a server; return how it ended.

    Raises:
        AssertionError: it was accepted wrongly, was not refused in one line, or the server has died.
    """
    said: list[str] = []
    found = PolicyServer(ControllerSpec(f"{__file__}:Still"), "panda", SECRET, port=0, said=said.append)
    threading.Thread(target=found.serve, daemon=True).start()
    answer: dict[str, Any] | None = None
    try:
        with connect(found.url, compression=None, close_timeout=0.05, logger=logger()) as stranger:
            stranger.send(message)
            answer = decode(stranger.recv(timeout=DEADLINE))
    except (WebSocketException, OSError):
        assert answer is None
    accepted = answer is not None and answer["kind"] == "welcome"
    if accepted:
        assert isinstance(message, bytes)
        plain = msgpack.unpackb(message)
        assert {**plain, "robot": "panda"} == HELLO, f"accepted: {plain!r}"
        assert plain.get("robot") in (None, "panda"), f"accepted: {plain!r}"
    else:
        _until(lambda: any("refused" in line for line in said))
        assert len(said) == 1, said
        check_line(answer["why"] if answer is not None else said[0])
    for line in said:
        check_line(line)
    _until(lambda: not accepted or said[-1].endswith("gone"))
    controller = RemoteController(found.url, deadline=DEADLINE)  # the server still works
    np.testing.assert_array_equal(controller.act(SEEN), ACTION)
    controller.close()
    found.close()
    return "accepted" if accepted else "refused"


def try_request(message: bytes | str | list[bytes], kind: str) -> str:
    """Send a request to a server after authentication; return how it ended.

    Raises:
        AssertionError: it was accepted wrongly, was not refused in one line, or the server has died.
    """
    said: list[str] = []
    found = PolicyServer(ControllerSpec(f"{__file__}:Still"), "panda", SECRET, port=0, said=said.append)
    threading.Thread(target=found.serve, daemon=True).start()
    answer: dict[str, Any] | None = None
    try:
        with connect(found.url, compression=None, close_timeout=0.05, logger=logger()) as loop:
            loop.send(encode(HELLO))
            assert decode(loop.recv(timeout=DEADLINE))["kind"] == "welcome"
            loop.send(message)
            answer = decode(loop.recv(timeout=DEADLINE))
    except (WebSocketException, OSError):
        assert answer is None
    accepted = answer is not None and answer["kind"] != "error"
    if accepted:
        assert answer is not None
        assert isinstance(message, bytes)
        plain = msgpack.unpackb(message)
        assert (answer["kind"], answer["number"]) == (
            {"act": "action", "reset": "ready"}[plain["kind"]],
            plain["number"],
        )
        assert type(plain["number"]) is int
        _same_observation(plain["observation"], found)
    elif answer is not None:
        check_line(answer["why"])
    _until(lambda: said[-1:] == ["127.0.0.1 gone"])
    for line in said:
        check_line(line)
    controller = RemoteController(found.url, deadline=DEADLINE)  # the server still works
    np.testing.assert_array_equal(controller.act(SEEN), ACTION)
    controller.close()
    found.close()
    return "accepted" if accepted else "refused"


def _same_observation(plain: Any, found: PolicyServer) -> None:
    """Compare the controller's observation with the one that was sent."""
    shown = type(found._controller).shown
    assert _packable(observation_to_message(shown)) == plain


def try_answer(message: bytes | str | list[bytes], kind: str) -> str:
    """Let a server answer a client; return how it ended.

    Raises:
        AssertionError: the answer was accepted wrongly, or was not refused in one line.
    """

    def handle(connection: Any) -> None:
        try:
            connection.recv()
            if kind != "welcome":
                connection.send(encode(WELCOME))
                connection.recv()
            connection.send(message)
            connection.recv()
        except WebSocketException:
            return

    found = serve(handle, "127.0.0.1", 0, compression=None, close_timeout=0.05, logger=logger())
    threading.Thread(target=found.serve_forever, daemon=True).start()
    url = f"ws://127.0.0.1:{found.socket.getsockname()[1]}"
    try:
        controller = RemoteController(url, "panda", deadline=client.CONNECTING)
        if kind == "ready":
            controller.reset(SEEN, 0)
        elif kind != "welcome":
            _same_action(controller.act(SEEN), message)
        _same_spec(controller.observation_spec, message)
        controller.close()
        return "accepted"
    except RemoteError as error:
        check_line(str(error))
        if url not in str(error):
            raise AssertionError("names no server") from error
        return "refused"
    finally:
        found.shutdown()


def _same_action(action: Any, message: Any) -> None:
    plain = msgpack.unpackb(message)
    assert (plain["kind"], plain["number"]) == ("action", 1)
    if action is None:
        assert plain["action"] is None
    else:
        kind, shape, data = plain["action"]["__array__"]
        np.testing.assert_array_equal(action, np.frombuffer(data, kind).astype(np.float32).reshape(shape))
        assert np.isfinite(action).all()


def _same_spec(spec: ObservationSpec, message: Any) -> None:
    given, found = msgpack.unpackb(message)["observation"], spec.to_dict()
    for name in ("modalities", "cameras"):
        words = given.get(name, getattr(ObservationSpec(), name))
        assert sorted([words] if isinstance(words, str) else words) == sorted(found[name]), name
    settings = {name: value for name, value in given.items() if name not in ("modalities", "cameras", "cloud")}
    _agrees({**(given.get("cloud") or {}), **settings}, {"source": "depth", **found["cloud"]})


def _agrees(given: Mapping[str, Any], found: Mapping[str, Any]) -> None:
    """Compare specs; for a cloud of keypoints, the image settings do not count."""
    for name, value in given.items():
        if isinstance(value, Mapping):
            _agrees(value, found[name])
        elif found.get("source") != "keypoints" or name in ("points", "source"):
            assert found[name] == value, f"{name}: {value!r} was read as {found[name]!r}"


def _until(done: Callable[[], bool]) -> None:
    end = time.monotonic() + DEADLINE
    while not done():
        assert time.monotonic() < end, "nothing was said"
        time.sleep(0.002)


# ---------------------------------------------------------------------------------------------------- processes


GOOD: Mapping[str, Sequence[Mapping[str, Any]]] = {
    "answers": ANSWERS,
    "first messages": (HELLO,),
    "requests": REQUESTS,
}
TRIED: Mapping[str, Callable[[bytes | str | list[bytes], str], str]] = {
    "answers": try_answer,
    "first messages": lambda message, _: try_first(message),
    "requests": try_request,
}


def drawn(number: int, seed: int, what: str) -> tuple[str, bytes | str | list[bytes]]:
    """Return the kind and the content of one hostile message."""
    generator = np.random.default_rng([seed, number, list(GOOD).index(what)])
    good = GOOD[what][number % len(GOOD[what])]
    return str(good["kind"]), hostile(good, generator)


def run(what: str, numbers: range, seed: int, scratch: Path, say: Say) -> Tally:
    """Try messages of a kind; report and count failures."""
    os.environ[TOKEN] = SECRET
    server.GREETING, server.CLOSING = DEADLINE, 0.02
    PolicyServer(ControllerSpec(f"{__file__}:Still"), "panda", SECRET, port=0).close()  # loads modules before forking
    folder = scratch / what
    folder.mkdir(parents=True)
    (folder / "canary.py").write_text(CANARY)

    def one(number: int) -> Ended:
        kind, message = drawn(number, seed, what)
        outcome, *cost = in_process(partial(TRIED[what], message, kind), folder)
        return Ended(f"{kind}: {outcome}", *cost)

    return tried(numbers, one, say)


if __name__ == "__main__":
    sys.exit(main(str(__doc__), {"inputs": 5000}, lambda _: {"inputs": [partial(run, what) for what in GOOD]}))

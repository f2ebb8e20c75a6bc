"""A controller behind a real websocket: its actions arrive, and clients without permission are refused."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

import gensim2
from gensim2.cli.main import cli
from gensim2.core.errors import InputError
from gensim2.perception import Camera, Observation, ObservationSpec, PointCloud
from gensim2.perception.observation import STATE, VELOCITY
from gensim2.policy.remote import protocol
from gensim2.policy.remote.client import RemoteController
from gensim2.policy.remote.protocol import (
    Act,
    ObservationMessage,
    RemoteError,
    decode,
    encode,
    observation_to_message,
    read_message,
)
from gensim2.policy.remote.server import PolicyServer
from gensim2.rollout.controller_spec import CHAIN, ControllerSpec
from gensim2_robot.faults import Fault
from gensim2_robot.run import run

TOKEN = "a token of no worth"
FILE = Path(__file__)
LEAVES = 13
"""Seed at which the controller ends the program."""


class Echo:
    """A fake controller that returns the observed joints, with delays and errors as configured."""

    observation_spec = ObservationSpec(modalities=())

    def __init__(self, slow: float = 0.0, fails_at: int = -1, looks: bool = False, cold: float = 0.0) -> None:
        self._slow, self._fails_at, self._acts, self._cold = slow, fails_at, 0, cold
        if looks:
            self.observation_spec = ObservationSpec()

    def reset(self, observation: Observation, seed: int) -> None:
        if seed == LEAVES:
            sys.exit(0)
        self._seed, self._acts = seed, 0

    def close(self) -> None:
        self.is_closed = True

    def act(self, observation: Observation) -> np.ndarray:
        self._acts += 1
        time.sleep(self._cold)
        self._cold = 0.0
        self.observation_spec = ObservationSpec(modalities=())
        if self._acts == self._fails_at:
            raise ValueError("as it was told to")
        if self._acts == 2:
            time.sleep(self._slow)
        return np.append(observation.joint_positions[:7], 1.0)


def observation(step: int = 0, points: int = 64) -> Observation:
    draw = np.random.default_rng(step)
    cloud = PointCloud(
        draw.normal(size=(points, 3)).astype("f4"), draw.integers(0, 255, (points, 3)).astype("u1"), None
    )
    arrays = {
        STATE: draw.normal(size=9).astype("f4"),
        VELOCITY: np.zeros(9, dtype="f4"),
    }
    return Observation(step, 0.1 * step, "close the box", arrays, cloud, {})


@pytest.fixture
def serving(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., PolicyServer]]:
    """Run servers in their own threads."""
    servers = []
    monkeypatch.setenv(protocol.TOKEN, TOKEN)

    def start(port: int = 0, token: str = TOKEN, **arguments: Any) -> PolicyServer:
        server = PolicyServer(ControllerSpec(f"{FILE}:Echo", arguments), "panda", token, port=port)
        threading.Thread(target=server.serve, daemon=True).start()
        servers.append(server)
        return server

    yield start
    for server in servers:
        server.close()


def test_what_a_controller_elsewhere_says_is_what_it_said(serving: Callable[..., PolicyServer]) -> None:
    server = serving()
    assert server.host == "127.0.0.1"
    controller = RemoteController(server.url, "panda", deadline=5.0)
    assert controller.observation_spec.modalities == ()
    shown = observation(3)
    controller.reset(shown, 5)
    action = controller.act(shown)
    np.testing.assert_array_equal(action[:7], shown.joint_positions[:7])
    controller.close()


def test_whoever_comes_next_is_told_all_that_is_looked_at(serving: Callable[..., PolicyServer]) -> None:
    server = serving(looks=True)
    for _ in range(2):  # the first one leaves while no observation is needed
        controller = RemoteController(server.url, "panda", deadline=5.0)
        assert controller.observation_spec.modalities == ("pointcloud",)
        controller.reset(observation(3), 5)
        controller.act(observation(3))
        assert controller.observation_spec.modalities == ()
        controller.close()


def test_observations_come_back_as_they_were() -> None:
    sent = observation(1)
    message = decode(encode({"kind": "x", "o": observation_to_message(sent)}))["o"]
    found = ObservationMessage.model_validate(message).value()
    assert (found.step, found.time, found.language) == (sent.step, sent.time, sent.language)
    for name in sent:
        np.testing.assert_array_equal(found[name], sent[name])
        assert found[name].dtype == sent[name].dtype


def test_a_wrong_token_is_refused_and_so_is_none(
    serving: Callable[..., PolicyServer], monkeypatch: pytest.MonkeyPatch
) -> None:
    server = serving()
    monkeypatch.setenv(protocol.TOKEN, "another token of no worth")
    with pytest.raises(RemoteError, match="refuses the connection: wrong token"):
        RemoteController(server.url)
    monkeypatch.delenv(protocol.TOKEN)
    with pytest.raises(InputError, match="is not set"):
        RemoteController(server.url)
    with pytest.raises(InputError, match="16 characters"):
        PolicyServer(ControllerSpec(f"{FILE}:Echo"), "panda", "short", port=0)


def test_another_version_another_robot_and_a_second_loop_are_refused(
    serving: Callable[..., PolicyServer], monkeypatch: pytest.MonkeyPatch
) -> None:
    server = serving()
    first = RemoteController(server.url)
    with pytest.raises(RemoteError, match="another loop"):
        RemoteController(server.url)
    first.close()
    with pytest.raises(RemoteError, match="drives fetch"):
        RemoteController(server.url, "fetch")
    monkeypatch.setattr("gensim2.policy.remote.client.VERSION", 2)
    with pytest.raises(RemoteError, match="version 2 of the protocol, this server uses 1"):
        RemoteController(server.url)


def test_a_late_answer_is_an_error_and_no_answer_to_anything_later(serving: Callable[..., PolicyServer]) -> None:
    controller = RemoteController(serving(slow=0.5).url, deadline=0.2)
    controller.reset(observation(0), 0)
    controller._deadline = 5.0
    controller.act(observation(1))
    controller._deadline = 0.2
    with pytest.raises(RemoteError, match="no answer within 200 ms"):
        controller.act(observation(2))
    controller._deadline = 5.0
    shown = observation(3)
    np.testing.assert_array_equal(controller.act(shown)[:7], shown.joint_positions[:7])


def test_what_is_too_large_is_refused_on_both_sides(serving: Callable[..., PolicyServer]) -> None:
    server = serving()
    controller = RemoteController(server.url, deadline=5.0)
    with pytest.raises(RemoteError, match="bytes"):
        controller.act(observation(0, points=2_000_000))
    controller.close()
    with connect(server.url, max_size=None, compression=None) as connection:
        connection.send(encode({"kind": "hello", "protocol": 1, "token": TOKEN}))
        assert decode(connection.recv())["kind"] == "welcome"
        with contextlib.suppress(ConnectionClosed):  # it may be closed before everything is sent
            connection.send(bytes(protocol.MAX_BYTES + 1))
        with pytest.raises(ConnectionClosed):
            connection.recv(timeout=10)
    RemoteController(server.url).close()  # the server still works


@pytest.mark.parametrize("data", [b"", b"\x80", b"\xc1", "text", encode({"kind": "act"}), encode({"kind": "hello"})])
def test_garbage_is_refused_before_anything_is_told(serving: Callable[..., PolicyServer], data: bytes | str) -> None:
    server = serving()
    with connect(server.url) as connection:
        connection.send(data)
        with contextlib.suppress(ConnectionClosed):  # or closed silently
            assert decode(connection.recv(timeout=5)) == {"kind": "refused", "why": "no token"}
    RemoteController(server.url).close()


def test_a_controller_that_fails_is_told_of_and_served_on(serving: Callable[..., PolicyServer]) -> None:
    controller = RemoteController(serving(fails_at=2).url, deadline=5.0)
    controller.reset(observation(0), 0)
    assert controller.act(observation(0)) is not None
    with pytest.raises(RemoteError, match="ValueError: as it was told to"):
        controller.act(observation(1))
    assert controller.act(observation(2)) is not None


def test_a_controller_that_leaves_the_program_is_told_of_and_served_on(serving: Callable[..., PolicyServer]) -> None:
    controller = RemoteController(serving().url, deadline=5.0)
    with pytest.raises(RemoteError, match="SystemExit: 0"):
        controller.reset(observation(0), LEAVES)
    assert controller.act(observation(1)) is not None


def test_a_server_that_is_closed_closes_its_controller() -> None:
    server = PolicyServer(ControllerSpec(f"{FILE}:Echo"), "panda", TOKEN, port=0)
    threading.Thread(target=server.serve, daemon=True).start()
    server.close()
    assert server._controller.is_closed  # type: ignore[attr-defined]


def test_the_first_action_of_a_network_counts_before_the_deadline(serving: Callable[..., PolicyServer]) -> None:
    controller = RemoteController(serving(cold=1.0).url, deadline=0.5)
    controller.reset(observation(0), 0)
    assert controller.act(observation(0)) is not None


def test_a_served_policy_is_evaluated_again_and_again(serving: Callable[..., PolicyServer], tmp_path: Path) -> None:
    arguments = {"url": serving().url, "robot": "panda", "deadline": 30.0}
    for number, controller in enumerate((RemoteController, "gensim2.policy:RemoteController")):
        found = gensim2.evaluate(
            controller,
            "CloseBox",
            arguments=arguments,
            episodes=1,
            workers=1,
            assets="builtin",
            out=tmp_path / str(number),
        )
        assert found.to_dict()["tasks"][0]["episodes"] == 1


def test_a_server_that_comes_back_with_another_token_ends_the_episode(serving: Callable[..., PolicyServer]) -> None:
    server = serving()
    controller = RemoteController(server.url, deadline=5.0)
    controller.reset(observation(0), 0)
    server.close()
    with contextlib.suppress(RemoteError):  # sent messages may still arrive
        controller.act(observation(0))
    with pytest.raises(RemoteError, match=r"is no longer reachable|cannot be reached"):
        controller.act(observation(0))
    serving(port=server.port, token="some other token of no worth")
    with pytest.raises(RemoteError, match="wrong token"):
        controller.act(observation(1))


def test_what_knows_the_truth_is_not_served() -> None:
    with pytest.raises(InputError, match="a policy server receives observations only"):
        PolicyServer(ControllerSpec(CHAIN), "panda", TOKEN, port=0)


@given(st.binary(max_size=200))
def test_no_bytes_are_more_than_an_error(data: bytes) -> None:
    with contextlib.suppress(RemoteError):
        assert isinstance(decode(data)["kind"], str)


def test_the_line_is_driven_by_a_controller_elsewhere_and_holds_where_it_is_late(
    serving: Callable[..., PolicyServer],
) -> None:
    quick: dict[str, Any] = {"assets": "builtin", "simulated_clock": True, "pixels": (64, 48), "minutes": 0.02}
    found = run("CloseBox", policy=serving(slow=1.0).url, deadline=0.5, **quick)
    assert found["limits_passed"] == 0
    assert (found["state"], "no answer within 500 ms" in found["reason"]) == ("holding", True), found["reason"]


def test_a_token_that_is_refused_while_it_runs_is_held(serving: Callable[..., PolicyServer]) -> None:
    quick: dict[str, Any] = {"assets": "builtin", "simulated_clock": True, "pixels": (64, 48), "minutes": 0.1}
    found = run("CloseBox", policy=serving().url, deadline=30.0, faults=[Fault("policy-token", 0.3)], **quick)
    assert (found["state"], "refuses the connection: wrong token" in found["reason"]) == ("holding", True), found[
        "reason"
    ]
    assert found["detected_to_stopped_ms"] <= 100.0 + 1e-6
    with pytest.raises(InputError, match="needs a policy server, because only a server"):
        run("CloseBox", faults=[Fault("policy-token", 0.3)], **quick)


def test_the_command_says_where_it_listens_and_needs_a_controller() -> None:
    said = CliRunner().invoke(cli, ["policy", "serve", "--help"]).output
    assert "127.0.0.1" in said
    with pytest.raises(InputError, match="no class"):
        PolicyServer(ControllerSpec(f"{FILE}:Nothing"), "panda", TOKEN, port=0)


def test_a_camera_s_calibration_of_depth_reaches_the_server() -> None:
    camera = replace(
        Camera.looking("left", (1.0, 0.5, 0.6), (0.5, 0.0, 0.1), width=64, height=48, fov=0.8), depth_scale=1.02
    )
    seen = Observation(0, 0.0, "close the box", {}, None, {"left": camera})
    message = decode(encode({"kind": "act", "number": 0, "observation": observation_to_message(seen)}))
    found = read_message(message, Act, Act, sender="The loop").observation.value().cameras["left"]
    assert (found.depth_scale, found.depth_bias) == (1.02, 0.0)
    assert np.array_equal(found.T_base_camera, camera.T_base_camera)
    plain = observation_to_message(replace(seen, cameras={"left": replace(camera, depth_scale=1.0)}))
    assert "depth_scale" not in plain["cameras"][0], "servers of 0.2 refuse fields that they do not know"

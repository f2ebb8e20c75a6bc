"""Use a policy server's controller like a local controller."""

from __future__ import annotations

import contextlib
import os
import reprlib
import socket
import struct
import time
from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import InputError, MissingExtraError
from gensim2.perception import Observation, ObservationSpec
from gensim2.policy.remote.protocol import (
    MAX_ANSWER,
    MAX_BYTES,
    TOKEN,
    VERSION,
    Action,
    Failure,
    Ready,
    Refusal,
    RemoteError,
    Welcome,
    decode,
    encode,
    is_url,
    observation_to_message,
    read_message,
)
from gensim2.policy.remote.websocket import logger, unfragmented

DEADLINE = 0.15
"""Default time limit for an action, s. The robot's watchdog stops the arm after 0.2 s without an action."""
CONNECTING = 10.0
"""Time limit for connecting and for a reset, s."""
LEAVING = 1.0
"""Time limit for a server to confirm that a connection is closed, s."""

Answer = TypeVar("Answer", Ready, Action)


class RemoteController:
    """Controller that requests each action from a policy server.

    A late answer raises an error and is ignored when it arrives. The error of an invalid answer names the server and
    the field.

    Args:
        url: address of the server, ``ws://host:port`` or ``wss://host:port``. The token is in ``GENSIM2_POLICY_TOKEN``.
        robot: name of the executing robot. None accepts the robot that the server names.
        deadline: time limit for an action, s.

    Attributes:
        observation_spec: modalities and cameras that the server's controller uses.

    Raises:
        InputError: the URL or the deadline is invalid, or the token is not set.
        RemoteError: the server cannot be reached, refuses the connection, or sends an invalid message.
        MissingExtraError: websockets or msgpack is not installed.

    Example:
        Set the environment variable ``GENSIM2_POLICY_TOKEN`` to the token that ``gensim2 policy serve`` prints. Then::

            controller = RemoteController("ws://127.0.0.1:8321", "panda")
            controller.reset(observation, seed=0)
            action = controller.act(observation)
            controller.close()
    """

    def __init__(self, url: str, robot: str | None = None, deadline: float = DEADLINE) -> None:
        if not is_url(url):
            raise InputError(f"{url!r} is not a websocket URL", field="policy", remedy="e.g. ws://127.0.0.1:8321")
        if not 0.0 < deadline < 1e4:
            raise InputError(f"must be a positive number of seconds, but is {deadline}", field="deadline")
        self._url, self._robot, self._deadline = url, robot, deadline
        self._server = f"The server {url}"
        self._number, self._action_size = 0, 0
        self._token = os.environ.get(TOKEN)
        self._connection: Any = None
        self.observation_spec = ObservationSpec()
        self._connect()

    def reset(self, observation: Observation, seed: int) -> None:
        """Start an episode.

        Raises:
            RemoteError: the server does not answer in time, fails, or sends an invalid message.
        """
        message = {"kind": "reset", "observation": observation_to_message(observation), "seed": seed}
        self._ask(message, Ready, CONNECTING)

    def act(self, observation: Observation) -> npt.NDArray[np.float32] | None:
        """Return the next action (m + 1,); None if the controller has ended the episode.

        Raises:
            RemoteError: the server does not answer in time, fails, or sends an invalid message.
        """
        message = {"kind": "act", "observation": observation_to_message(observation)}
        action: npt.NDArray[np.float32] | None = self._ask(message, Action, self._deadline).action
        if action is not None and action.shape != (self._action_size,):
            said = f"action must be an array of shape ({self._action_size},), got {action.shape}"
            raise RemoteError(f"{self._server} sent an invalid action: {said}")
        return action

    def close(self) -> None:
        """Close the connection; the next request opens a new connection."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def disown(self) -> None:
        """Close the connection, and use a wrong token for the next connection.

        ``gensim2 robot`` causes this fault to test its watchdog with a server that refuses the connection.
        """
        self.close()
        self._token = f"not {self._token}"

    def _connect(self) -> None:
        try:
            from websockets.exceptions import WebSocketException
            from websockets.sync.client import ClientConnection, connect
        except ImportError as error:
            raise MissingExtraError("websockets", "remote") from error
        if not self._token:
            raise InputError("is not set", field=TOKEN, remedy="set it to the token that gensim2 policy serve prints")
        hello = {"kind": "hello", "protocol": VERSION, "token": self._token, "robot": self._robot}
        try:
            connection = connect(
                self._url,
                max_size=MAX_ANSWER,
                compression=None,
                open_timeout=CONNECTING,
                close_timeout=LEAVING,
                proxy=None,
                logger=logger(),
                create_connection=unfragmented(ClientConnection),
            )
            self._connection = connection
            # A server that stops reading must not block the client, so sending has a timeout.
            seconds, share = divmod(self._deadline, 1.0)
            limit = struct.pack("ll", int(seconds), int(1e6 * share) or 1)
            connection.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, limit)
            connection.send(encode(hello))
            found = decode(connection.recv(timeout=CONNECTING), MAX_ANSWER, self._server)
            if found["kind"] == "welcome" and found.get("protocol") != VERSION:
                spoken = reprlib.repr(found.get("protocol"))
                raise RemoteError(f"{self._url} uses protocol version {spoken}, but this client uses version {VERSION}")
            answer = read_message(found, Welcome, Refusal, sender=self._server)
            if isinstance(answer, Refusal):
                raise RemoteError(f"{self._url} refuses the connection: {answer.why}")
            if self._robot not in (None, answer.robot):
                raise RemoteError(f"{self._url} serves the robot {answer.robot}, but this robot is {self._robot}")
            self._action_size = answer.action_size
            self._look(answer.observation)
        except (OSError, WebSocketException) as error:
            self._drop()
            raise RemoteError(f"{self._url} cannot be reached: {error}") from error
        except RemoteError:
            self._drop()
            raise
        # The websockets library raises AssertionError if the server does not answer the handshake with HTTP.
        except AssertionError as error:
            wrong = "the server did not send a valid HTTP response"
            raise RemoteError(f"{self._url} cannot be reached: {wrong}") from error

    def _ask(self, message: dict[str, Any], expected: type[Answer], deadline: float) -> Answer:
        """Send a request and return the answer.

        Reconnect if necessary. After reconnecting, the first request must be a reset.
        """
        from websockets.exceptions import WebSocketException

        if self._connection is None:
            self._connect()
            if message["kind"] != "reset":
                raise RemoteError(f"the connection to {self._url} was interrupted, so the episode must start again")
        self._number += 1
        until = time.monotonic() + deadline
        data = encode({**message, "number": self._number})
        if len(data) > MAX_BYTES:
            raise RemoteError(f"an observation has {len(data)} bytes, but the limit is {MAX_BYTES}")
        try:
            self._connection.send(data)
            answer = self._answer(expected, until)
        except TimeoutError as error:
            raise RemoteError(f"{self._url} gave no answer within {1e3 * deadline:.0f} ms") from error
        except (OSError, WebSocketException) as error:
            self._drop()
            raise RemoteError(f"{self._url} is no longer reachable: {error}") from error
        if isinstance(answer, Failure):
            raise RemoteError(f"{self._url}: {answer.why}")
        self._look(answer.observation)
        return answer

    def _answer(self, expected: type[Answer], until: float) -> Answer | Failure:
        """Return the answer to the last request, and discard answers to earlier requests."""
        while (left := until - time.monotonic()) > 0.0:
            found = decode(self._connection.recv(timeout=left), MAX_ANSWER, self._server)
            number = found.get("number")
            if type(number) is int and 0 < number < self._number:
                continue
            answer: Answer | Failure = read_message(found, expected, Failure, sender=self._server)
            if answer.number not in (None, self._number):
                wrong = f"{self._server} answered request {answer.number}, but the last request was {self._number}"
                raise RemoteError(wrong)
            return answer
        raise TimeoutError

    def _drop(self) -> None:
        from websockets.exceptions import WebSocketException

        with contextlib.suppress(OSError, WebSocketException):
            self.close()
        self._connection = None

    def _look(self, observation: Mapping[str, Any]) -> None:
        try:
            self.observation_spec = ObservationSpec.of(observation)
        except InputError as error:
            said = f"{(error.field or '').removeprefix('observation.')} {error.message}"
            raise RemoteError(f"{self._server} sent an invalid observation spec: {said}") from error

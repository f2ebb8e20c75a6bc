"""A controller elsewhere as a controller here."""

from __future__ import annotations

import contextlib
import os
import time
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.deploy.remote.protocol import (
    MAX_BYTES,
    TOKEN,
    VERSION,
    RemoteError,
    decode,
    encode,
    is_url,
    observation_to_message,
)
from gensim2.errors import InputError, MissingExtraError
from gensim2.observations import Observation, ObservationSpec

DEADLINE = 0.15
"""Seconds within which an action must come: the watch holds after 0.2."""
CONNECTING = 10.0
"""Seconds within which a server must answer at all, and a controller be reset."""


class RemoteController:
    """Asks a server for each action; an answer that is late is an error now, and no answer to anything later.

    Args:
        url: of the server, ``ws://host:port`` or ``wss://``. The token is in the environment, GENSIM2_POLICY_TOKEN.
        robot: that is driven; None: whatever the server's is.
        deadline: seconds within which an action must come.

    Attributes:
        observation_spec: what it looks at.

    Raises:
        InputError: the URL is none.
        RemoteError: the server cannot be reached, or refuses.
        MissingExtraError: websockets or msgpack is not installed.
    """

    def __init__(self, url: str, robot: str | None = None, deadline: float = DEADLINE) -> None:
        if not is_url(url):
            raise InputError(f"{url!r} is no websocket", field="policy", remedy="as ws://127.0.0.1:8321")
        if not 0.0 < deadline < 1e4:
            raise InputError(f"must be positive seconds, is {deadline}", field="deadline")
        self._url, self._robot, self._deadline = url, robot, deadline
        self._number = 0
        self._token = os.environ.get(TOKEN)
        self._connection: Any = None
        self.observation_spec = ObservationSpec()
        self._connect()

    def reset(self, observation: Observation, seed: int) -> None:
        """Begin an episode.

        Raises:
            RemoteError: the server does not answer in time, or fails.
        """
        self._ask({"kind": "reset", "observation": observation_to_message(observation), "seed": seed}, CONNECTING)

    def act(self, observation: Observation) -> npt.NDArray[np.float32] | None:
        """The next action.

        Raises:
            RemoteError: the server does not answer in time, or fails.
        """
        found = self._ask({"kind": "act", "observation": observation_to_message(observation)}, self._deadline)
        action = found.get("action")
        if action is not None and not isinstance(action, np.ndarray):
            raise RemoteError("an action must be an array")
        return action

    def close(self) -> None:
        """Leave the server."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def disown(self) -> None:
        """Come back with a token that the server does not know: a fault, to see what the watch makes of it."""
        self.close()
        self._token = f"not {self._token}"

    def _connect(self) -> None:
        try:
            from websockets.exceptions import WebSocketException
            from websockets.sync.client import connect
        except ImportError as error:
            raise MissingExtraError("websockets", "robot") from error
        if not self._token:
            raise InputError("is not set", field=TOKEN, remedy="export what gensim2 policy serve says")
        try:
            self._connection = connect(
                self._url, max_size=MAX_BYTES, compression=None, open_timeout=CONNECTING, proxy=None
            )
            self._connection.send(
                encode({"kind": "hello", "protocol": VERSION, "token": self._token, "robot": self._robot})
            )
            found = decode(self._connection.recv(timeout=CONNECTING))
        except (OSError, WebSocketException) as error:
            raise RemoteError(f"{self._url} cannot be reached: {error}") from error
        if found["kind"] == "refused":
            self.close()
            raise RemoteError(f"{self._url} refuses: {found.get('why')}")
        if found["kind"] != "welcome" or found.get("protocol") != VERSION:
            self.close()
            raise RemoteError(f"{self._url} speaks version {found.get('protocol')} of the protocol, this is {VERSION}")
        self._look(found)

    def _ask(self, message: dict[str, Any], deadline: float) -> dict[str, Any]:
        """The answer to a request.

        A server that went away is connected to once more: a controller that was started anew knows nothing of the
        episode, so that only a reset may go on with it.
        """
        from websockets.exceptions import WebSocketException

        if self._connection is None:
            self._connect()
            if message["kind"] != "reset":
                raise RemoteError(f"{self._url} was away: the episode is begun anew")
        self._number += 1
        until = time.monotonic() + deadline
        data = encode({**message, "number": self._number})
        if len(data) > MAX_BYTES:
            raise RemoteError(f"an observation has {len(data)} bytes, {MAX_BYTES} at most")
        try:
            self._connection.send(data)
            while True:
                found = decode(self._connection.recv(timeout=max(0.0, until - time.monotonic())))
                if found.get("number") == self._number:
                    break
                if found["kind"] == "error" and found.get("number") is None:
                    break
        except TimeoutError as error:
            raise RemoteError(f"{self._url} gave no answer within {1e3 * deadline:.0f} ms") from error
        except (OSError, WebSocketException) as error:
            with contextlib.suppress(OSError, WebSocketException):
                self.close()
            self._connection = None
            raise RemoteError(f"{self._url} is gone: {error}") from error
        if found["kind"] == "error":
            raise RemoteError(f"{self._url}: {found.get('why')}")
        self._look(found)
        return found

    def _look(self, message: dict[str, Any]) -> None:
        try:
            self.observation_spec = ObservationSpec.of(message["observation"])
        except (KeyError, InputError) as error:
            raise RemoteError(f"{self._url} says no observation that there is: {error}") from error

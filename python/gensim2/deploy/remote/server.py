"""``gensim2 policy serve``: a controller behind a websocket."""

from __future__ import annotations

import hmac
import threading
from collections.abc import Callable
from typing import Any

import numpy as np

import gensim2
from gensim2.deploy.remote.protocol import (
    MAX_BYTES,
    PORT,
    TOKEN_LENGTH,
    VERSION,
    RemoteError,
    decode,
    encode,
    observation_of,
)
from gensim2.errors import GenSim2Error, InputError, MissingExtraError, one_line
from gensim2.robots import robot
from gensim2.rollout.controller import Controller, is_privileged, spec_of
from gensim2.rollout.controller_spec import ControllerSpec

GREETING = 5.0
"""Seconds within which whoever connects must say the token."""

LEAVING = 1.0
"""Seconds for which a loop waits for the one before it, whose connection is being closed, before it is refused."""


class PolicyServer:
    """Serves one controller to one loop at a time.

    Args:
        controller: how it is made; must not be privileged.
        robot_name: that it drives.
        token: that whoever asks must know; 16 characters or more.
        host, port: that it listens at; port 0: any that is free.
        said: is told of connections, a line each.

    Raises:
        InputError: the controller is shown the truth of a simulation, or the token is too short.
        ControllerError: the controller cannot be made with its arguments.
        MissingExtraError: websockets or msgpack is not installed.
    """

    def __init__(
        self,
        controller: ControllerSpec,
        robot_name: str,
        token: str,
        *,
        host: str = "127.0.0.1",
        port: int = PORT,
        said: Callable[[str], None] = lambda line: None,
    ) -> None:
        if len(token) < TOKEN_LENGTH:
            raise InputError(f"must have {TOKEN_LENGTH} characters at least", field="token")
        kind = controller.load()
        if is_privileged(kind):
            raise InputError("is shown the truth of a simulated world, which does not travel", field=controller.target)
        try:
            from websockets.sync.server import serve
        except ImportError as error:
            raise MissingExtraError("websockets", "robot") from error
        encode({})  # msgpack is there
        self._spec, self._token, self._said = controller, token, said
        self._profile = robot(robot_name)
        self._controller: Controller = controller.make()
        self._observation = spec_of(self._controller).to_dict()  # now: one that acts may look at less for a while
        self._busy = threading.Lock()
        self._connections: set[Any] = set()
        try:
            self._server = serve(self._handle, host, port, max_size=MAX_BYTES, compression=None)
        except OSError as error:
            raise InputError(f"cannot listen: {error.strerror}", field=f"{host}:{port}") from error
        self.host, self.port = self._server.socket.getsockname()[:2]

    @property
    def url(self) -> str:
        """Address that a loop connects to."""
        return f"ws://{self.host}:{self.port}"

    def serve(self) -> None:
        """Answer until :meth:`close` is called."""
        self._server.serve_forever()

    def close(self) -> None:
        """Listen no more, and leave whoever is connected."""
        self._server.shutdown()
        for connection in list(self._connections):
            connection.close()

    def _handle(self, connection: Any) -> None:
        from websockets.exceptions import ConnectionClosed

        who = connection.remote_address[0]
        try:
            refused = self._greet(decode(connection.recv(timeout=GREETING)))
            if refused is None and not self._busy.acquire(timeout=LEAVING):
                refused = "another loop is being served"
            if refused is not None:
                self._said(f"{who} refused: {refused}")
                connection.send(encode({"kind": "refused", "why": refused}))
                return
        except (RemoteError, TimeoutError, ConnectionClosed) as error:
            self._said(f"{who} refused: {one_line(str(error)) or type(error).__name__}")
            return
        try:
            self._said(f"{who} connected")
            self._connections.add(connection)
            connection.send(encode(self._welcome()))
            for data in connection:
                connection.send(encode(self._answer(data)))
        except ConnectionClosed as error:
            self._said(f"{who}: {one_line(str(error))}")
        finally:
            self._connections.discard(connection)
            self._busy.release()
            self._said(f"{who} gone")

    def _greet(self, hello: dict[str, Any]) -> str | None:
        """Why whoever says hello is refused; None: welcome. The token comes first: without it nothing is told."""
        token = hello.get("token")
        if hello["kind"] != "hello" or not isinstance(token, str):
            return "no token"
        if not hmac.compare_digest(token.encode(), self._token.encode()):
            return "wrong token"
        if hello.get("protocol") != VERSION:
            return (
                f"speaks version {hello.get('protocol')} of the protocol, this is {VERSION}: install the same gensim2"
            )
        if hello.get("robot") not in (None, self._profile.name):
            return f"drives {hello['robot']}, this controller is for {self._profile.name}"
        return None

    def _welcome(self) -> dict[str, Any]:
        return {
            "kind": "welcome",
            "protocol": VERSION,
            "gensim2": gensim2.__version__,
            "controller": self._spec.target,
            "robot": self._profile.name,
            "action_size": self._profile.action_size,
            "observation": self._observation,
        }

    def _answer(self, data: Any) -> dict[str, Any]:
        number: Any = None
        try:
            message = decode(data)
            number = message.get("number")
            observation = observation_of(message.get("observation"))
            if message["kind"] == "reset":
                self._controller.reset(observation, int(message["seed"]))
                found: dict[str, Any] = {"kind": "ready"}
            elif message["kind"] == "act":
                action = self._controller.act(observation)
                found = {
                    "kind": "action",
                    "action": None if action is None else np.asarray(action, dtype=np.float32),
                }
            else:
                raise RemoteError(f"no request {message['kind']!r}")
            return {**found, "number": number, "observation": spec_of(self._controller).to_dict()}
        except GenSim2Error as error:
            return {"kind": "error", "number": number, "why": str(error)}
        except Exception as error:  # noqa: BLE001 - a controller of anybody's; its loop is told, and goes on
            return {"kind": "error", "number": number, "why": one_line(f"{type(error).__name__}: {error}")}

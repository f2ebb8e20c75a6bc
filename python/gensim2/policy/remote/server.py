"""Serve a controller over a websocket (``gensim2 policy serve``).

A client is a stranger until its first message has shown the token. The number of strangers is limited. Each stranger
has its own thread, a few seconds and a few kB. Only one authenticated client at a time uses the controller.
"""

from __future__ import annotations

import hmac
import math
import reprlib
import socket
import struct
import sys
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

import gensim2
from gensim2.core.cores import SWITCH_INTERVAL
from gensim2.core.errors import GenSim2Error, InputError, MissingExtraError, described, one_line, user_code
from gensim2.policy.remote.protocol import (
    MAX_BYTES,
    MAX_HELLO,
    PORT,
    TOKEN_LENGTH,
    VERSION,
    Act,
    Hello,
    RemoteError,
    Reset,
    decode,
    encode,
    read_message,
)
from gensim2.policy.remote.websocket import CHUNK, logger, unfragmented
from gensim2.robots import robot
from gensim2.rollout.controller import Controller, is_privileged, spec_of
from gensim2.rollout.controller_spec import ControllerError, ControllerSpec, close

GREETING = 5.0
"""Time limit (s) for a stranger to open the websocket, and then again to send the token."""
LEAVING = 1.0
"""Maximum time for which a new client waits until the previous client's connection is closed, s."""
CLOSING = 0.2
"""Time limit for a client to confirm the end of its connection, s; data received meanwhile are discarded."""
MAX_STRANGERS = 4
"""Maximum number of connections without a token; additional connections are closed at once."""
MAX_CONTROL_FRAMES = 100
"""Maximum number of websocket control frames from a stranger; one more closes the connection."""
READING = 1.0
"""Time limit (s) for sending a message, because a client may have stopped reading."""


class PolicyServer:
    """Serves a controller to one client at a time.

    Args:
        controller: specification of the controller, which must not need the true state of a simulation.
        robot_name: name of the robot that the controller drives.
        token: secret of at least 16 characters that clients must send.
        host, port: address to listen on; port 0 selects a free port.
        said: callback that gets a line of text for each connection event.

    Raises:
        InputError: the controller is privileged, or the token is too short.
        ControllerError: the controller cannot be created with the given arguments.
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
            raise InputError(f"must have at least {TOKEN_LENGTH} characters", field="token")
        kind = controller.load()
        if is_privileged(kind):
            wrong = (
                "the controller needs the true state of the simulator, but a policy server receives observations only"
            )
            raise InputError(wrong, field=controller.target)
        try:
            from websockets.sync.server import ServerConnection, serve
        except ImportError as error:
            raise MissingExtraError("websockets", "remote") from error
        # Encode an empty message, so that a missing msgpack is reported now.
        encode({})
        self._spec, self._token, self._said = controller, token, said
        self._profile = robot(robot_name)
        self._controller: Controller = controller.make()
        # Read the spec before the episode. During an episode, a controller may ask only for the robot's state.
        self._observation = spec_of(self._controller).to_dict()
        self._is_warm = False
        self._busy = threading.Lock()
        self._connections: set[Any] = set()
        self._strangers = threading.BoundedSemaphore(MAX_STRANGERS)
        self._peer = threading.local()  # each connection has its own thread
        try:
            self._server = serve(
                self._handle,
                host,
                port,
                max_size=MAX_HELLO,
                compression=None,
                open_timeout=GREETING,
                close_timeout=CLOSING,
                logger=logger(said),
                create_connection=unfragmented(ServerConnection, MAX_HELLO, MAX_CONTROL_FRAMES),
            )
        except OSError as error:
            raise InputError(f"cannot listen: {error.strerror}", field=f"{host}:{port}") from error
        self._speak, self._server.handler = self._server.handler, self._admit
        self.host, self.port = self._server.socket.getsockname()[:2]

    @property
    def url(self) -> str:
        """Address for clients."""
        return f"ws://{self.host}:{self.port}"

    def serve(self) -> None:
        """Serve until :meth:`close` is called."""
        before = sys.getswitchinterval()
        # Switch threads often, so that threads of untrusted clients hardly delay the controller's thread.
        sys.setswitchinterval(SWITCH_INTERVAL)
        try:
            self._server.serve_forever()
        finally:
            sys.setswitchinterval(before)

    def close(self) -> None:
        """Stop listening, and close all connections and the controller.

        Raises:
            ControllerError: the controller's ``close`` fails.
        """
        self._server.shutdown()
        for connection in list(self._connections):
            connection.close()
        close(self._controller)

    def _admit(self, peer: socket.socket, address: Any) -> None:
        """Serve a connection, or close it if too many clients without a verified token are connected."""
        if not self._strangers.acquire(blocking=False):
            peer.close()
            return
        self._peer.address, self._peer.is_known = address, False
        try:
            # Sending needs a timeout. The websockets library holds a lock while it answers a ping, and it needs the
            # same lock to close the connection. Without a timeout, a client that reads nothing could prevent closing.
            seconds, share = divmod(READING, 1.0)
            peer.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("ll", int(seconds), int(1e6 * share)))
            self._speak(peer, address)
        finally:
            self._trust()

    def _trust(self) -> None:
        """Stop counting this thread's client among the clients whose token is not verified."""
        if not self._peer.is_known:
            self._peer.is_known = True
            self._strangers.release()

    def _handle(self, connection: Any) -> None:
        from websockets.exceptions import ConnectionClosed

        # The address was stored when the connection was accepted, because a closed socket does not return it.
        who = str(self._peer.address[0])
        try:
            hello = decode(connection.recv(timeout=GREETING), MAX_HELLO, who)
            refused = self._greet(hello, who)
            if refused is None:
                self._trust()
                if not self._busy.acquire(timeout=LEAVING):
                    refused = "another loop is being served (a server serves one at a time: evaluate with one worker)"
            if refused is not None:
                refused = one_line(refused)
                self._said(f"{who} refused: {refused}")
                connection.send(encode({"kind": "refused", "why": refused}))
                return
        except (RemoteError, TimeoutError, ConnectionClosed) as error:
            self._said(f"{who} refused: {one_line(str(error)) or type(error).__name__}")
            return
        try:
            self._said(f"{who} connected")
            self._connections.add(connection)
            connection.max_control_frames = math.inf
            connection.protocol.max_message_size, connection.recv_bufsize = MAX_BYTES, CHUNK
            connection.send(encode(self._welcome()))
            for data in connection:
                connection.send(encode(self._answer(data, who)))
        except ConnectionClosed as error:
            # If the client's process ends, the client sends no close frame. This is normal, so it is not reported.
            if error.rcvd is not None or error.sent is not None:
                self._said(f"{who}: {one_line(str(error))}")
        finally:
            self._connections.discard(connection)
            self._busy.release()
            self._said(f"{who} gone")

    def _greet(self, message: dict[str, Any], who: str) -> str | None:
        """Return, only for clients with the correct token, the reason for refusing a client, or None."""
        token = message.get("token")
        if message["kind"] != "hello" or not isinstance(token, str):
            return "no token"
        if not hmac.compare_digest(token.encode(), self._token.encode()):
            return "wrong token"
        spoken = message.get("protocol")
        if spoken != VERSION:
            said = reprlib.repr(spoken)
            return f"uses version {said} of the protocol, this server uses {VERSION}: install the same gensim2"
        try:
            hello = read_message(message, Hello, Hello, sender=who)
        except RemoteError as error:
            return str(error)
        if hello.robot not in (None, self._profile.name):
            return f"drives {hello.robot}, this controller is for {self._profile.name}"
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

    def _answer(self, data: Any, who: str) -> dict[str, Any]:
        number: int | None = None
        try:
            with user_code(lambda error: ControllerError(described(error)), GenSim2Error):
                request = read_message(decode(data, sender=who), Reset, Act, sender=who)
                number = request.number
                observation = request.observation.value()
                if isinstance(request, Reset):
                    self._controller.reset(observation, request.seed)
                    if not self._is_warm:
                        # The first action of a network takes longest. Compute it during the reset, which has no
                        # deadline.
                        self._controller.act(observation)
                        self._is_warm = True
                        self._controller.reset(observation, request.seed)
                    found: dict[str, Any] = {"kind": "ready"}
                else:
                    found = {"kind": "action", "action": self._action(self._controller.act(observation))}
                return {**found, "number": number, "observation": spec_of(self._controller).to_dict()}
        except (GenSim2Error, MemoryError) as error:  # the client gets the error, and the server continues
            return {"kind": "error", "number": number, "why": one_line(str(error) or type(error).__name__)}

    def _action(self, given: Any) -> npt.NDArray[np.float32] | None:
        if given is None:
            return None
        with np.errstate(over="ignore"):
            action = np.asarray(given, dtype=np.float32)
        if action.shape != (self._profile.action_size,):
            raise RemoteError(
                f"the controller returned an action of shape {action.shape}, but the robot needs "
                f"{self._profile.action_size} values"
            )
        if not np.isfinite(action).all():
            raise RemoteError("the controller returned an action that contains NaN or infinity")
        return action

"""A fake server with the OpenAI protocol on loopback, with scripted answers and faults.

It checks paths, fields and the images' data URLs of requests.
"""

from __future__ import annotations

import base64
import binascii
import json
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Self

KEY = "sk-test-0123456789"

#: First line of the prompt of each stage.
STAGES = {
    "# Task proposal": "proposal",
    "# Reflection": "reflection",
    "# Task decomposition": "decomposition",
    "# Task composition": "composition",
    "# Code generation": "code",
    "# Whole task": "free",
    "# Solver stage 1: constraints": "constraints",
    "# Solver stage 2: motions": "motions",
    "# Regeneration": "regeneration",
}


@dataclass(frozen=True)
class Asked:
    """A request.

    Attributes:
        stage: which prompt it is.
        prompt: the first message of the conversation.
        last: the last message: the prompt, or what was wrong with the previous answer.
        pictures: PNG images of the request.
        body: the whole request.
    """

    stage: str
    prompt: str
    last: str
    pictures: tuple[bytes, ...]
    body: dict[str, Any]

    @property
    def again(self) -> bool:
        """Whether the request complains about an answer."""
        return len(self.body["messages"]) > 2


@dataclass(frozen=True)
class Fault:
    """A fault instead of an answer.

    Attributes:
        status: HTTP status; 0: the connection is cut in the middle of the answer.
        headers: additional headers.
        hang: seconds before the answer starts.
        body: body of the answer.
    """

    status: int = 200
    headers: tuple[tuple[str, str], ...] = ()
    hang: float = 0.0
    body: bytes = b'{"error": {"message": "made to fail", "type": "test"}}'


RATE_LIMIT = Fault(429)
RATE_LIMIT_WAIT = Fault(429, (("Retry-After", "0.05"),))
SERVER_ERROR = Fault(500)
CUT = Fault(0)
HALF_A_BODY = Fault(200, body=b'{"id": "x", "object": "chat.completion", "choices": [{"index": 0, "mess')
NO_SCHEMA = Fault(
    400, body=b'{"error": {"message": "response_format json_schema is not supported", "type": "invalid"}}'
)

Script = Callable[[Asked], str]


@dataclass
class ModelServer:
    """A context manager that answers by ``script``; each of ``faults`` replaces one answer, in order.

    Requests for which ``broken`` returns True get the status 500.
    """

    script: Script
    faults: deque[Fault] = field(default_factory=deque)
    broken: Callable[[dict[str, Any]], bool] = lambda body: False
    key: str | None = KEY
    finish: str = "stop"
    asked: list[Asked] = field(default_factory=list)
    requests: int = 0

    def __enter__(self) -> Self:
        outer = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_GET(self) -> None:
                outer._models(self)

            def do_POST(self) -> None:
                outer._chat(self)

            def log_message(self, format: str, *args: Any) -> None:
                """Discard the server's log."""

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    @property
    def url(self) -> str:
        """Base URL for clients."""
        return f"http://127.0.0.1:{self._server.server_address[1]}/v1"

    def stages(self) -> list[str]:
        """Stages of the requests, in order."""
        return [asked.stage for asked in self.asked]

    def _models(self, handler: BaseHTTPRequestHandler) -> None:
        if not self._knows(handler):
            return
        models = {
            "object": "list",
            "data": [{"id": "test-model", "object": "model", "created": 0, "owned_by": "tests"}],
        }
        _send(handler, 200, json.dumps(models).encode())

    def _chat(self, handler: BaseHTTPRequestHandler) -> None:
        self.requests += 1
        data = handler.rfile.read(int(handler.headers["Content-Length"]))
        if self.faults and self._faulty(handler, self.faults.popleft()):
            return
        if self.broken(json.loads(data)):
            _send(handler, 500, SERVER_ERROR.body)
            return
        if not self._knows(handler):
            return
        if handler.path != "/v1/chat/completions":
            _send(handler, 404, _error(f"no {handler.path}"))
            return
        try:
            asked = _asked(json.loads(data))
        except (ValueError, KeyError, TypeError) as error:
            _send(handler, 400, _error(f"bad request: {error!r}"))
            return
        self.asked.append(asked)
        text = self.script(asked)
        answer = {
            "id": "chatcmpl-1",
            "object": "chat.completion",
            "created": 0,
            "model": asked.body["model"],
            "choices": [{"index": 0, "message": {"role": "assistant", "content": text}, "finish_reason": self.finish}],
            "usage": {
                "prompt_tokens": len(asked.prompt) // 4,
                "completion_tokens": len(text) // 4,
                "total_tokens": (len(asked.prompt) + len(text)) // 4,
            },
        }
        _send(handler, 200, json.dumps(answer).encode())

    def _knows(self, handler: BaseHTTPRequestHandler) -> bool:
        given = handler.headers.get("Authorization", "")
        if self.key is not None and given != f"Bearer {self.key}":
            _send(handler, 401, _error(f"Incorrect API key provided: {given.removeprefix('Bearer ')}"))
            return False
        return True

    def _faulty(self, handler: BaseHTTPRequestHandler, fault: Fault) -> bool:
        time.sleep(fault.hang)
        if fault.status == 0:
            handler.send_response(200)
            handler.send_header("Content-Length", "1000")
            handler.end_headers()
            handler.wfile.write(b'{"id": ')
            handler.close_connection = True
            return True
        _send(handler, fault.status, fault.body, fault.headers)
        return True


def _asked(body: dict[str, Any]) -> Asked:
    messages = body["messages"]
    assert isinstance(body["model"], str)
    first = next(message for message in messages if message["role"] == "user")
    prompt, pictures = _text_and_pictures(first["content"])
    last, _ = _text_and_pictures(messages[-1]["content"])
    first_line = prompt.splitlines()[0]
    return Asked(STAGES.get(first_line, first_line), prompt, last, tuple(pictures), body)


def _text_and_pictures(content: str | Sequence[dict[str, Any]]) -> tuple[str, list[bytes]]:
    """Return text and images of a message; invalid images are a bad request."""
    if isinstance(content, str):
        return content, []
    text, pictures = "", []
    for part in content:
        if part["type"] == "text":
            text += part["text"]
            continue
        url = part["image_url"]["url"]
        head, comma, data = url.partition(",")
        if head != "data:image/png;base64" or not comma:
            raise ValueError(f"a picture that is no data URL of a PNG: {url[:40]}")
        try:
            picture = base64.b64decode(data, validate=True)
        except binascii.Error as error:
            raise ValueError("a picture that is not base64") from error
        if not picture.startswith(b"\x89PNG\r\n\x1a\n"):
            raise ValueError("a picture that is no PNG")
        pictures.append(picture)
    return text, pictures


def _error(message: str) -> bytes:
    return json.dumps({"error": {"message": message, "type": "invalid_request_error"}}).encode()


def _send(handler: BaseHTTPRequestHandler, status: int, body: bytes, headers: Sequence[tuple[str, str]] = ()) -> None:
    try:
        handler.send_response(status)
        handler.send_header("Content-Type", "application/json")
        handler.send_header("Content-Length", str(len(body)))
        for name, value in headers:
            handler.send_header(name, value)
        handler.end_headers()
        handler.wfile.write(body)
    except (BrokenPipeError, ConnectionResetError):
        handler.close_connection = True  # the client has left

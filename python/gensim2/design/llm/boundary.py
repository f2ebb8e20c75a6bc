"""Read an endpoint's replies within limits on time and size, and clean the text of the replies.

The cleaning removes API keys and lone surrogates (characters that UTF-8 cannot encode).

Endpoints may be broken or untrusted. Therefore answers, refusals, headers and errors pass through :class:`Boundary`.
"""

from __future__ import annotations

import json
import math
import queue
import re
import threading
from collections.abc import Callable
from functools import cached_property
from typing import Any, TypeVar

_WORDS = """
anything api-key changeme dummy dummy-key empty fake fake-key key lm-studio local local-key my-api-key no-key
no-key-needed no-key-required none not-needed not-required nothing null ollama openai placeholder secret sk-dummy
sk-fake sk-local sk-no-key-needed sk-no-key-required sk-none sk-xxx test test-key token unused x your-api-key
your-api-key-here your_api_key
"""

DUMMIES = frozenset(_WORDS.split())
"""Placeholder keys, in lower case, for endpoints that need no key."""

SHORTEST = 8
"""Minimum number of characters of a secret."""

HIDDEN = "***"


class Secret:
    """API key that prints as ``***``.

    Args:
        value: the key as sent to the endpoint.
    """

    def __init__(self, value: str) -> None:
        self._value = value

    def __repr__(self) -> str:
        return HIDDEN

    __str__ = __repr__

    def __bool__(self) -> bool:
        return bool(self._value)

    def reveal(self) -> str:
        """Return the key in clear text; only the client may call this method."""
        return self._value

    @property
    def can_be_sent(self) -> bool:
        """Return whether an HTTP header may contain all characters of the key."""
        return self._value.isascii() and self._value.isprintable() and " " not in self._value

    @property
    def is_secret(self) -> bool:
        """Return whether the key must be hidden; a placeholder such as ``"EMPTY"`` need not be hidden."""
        return len(self._value) >= SHORTEST and self._value.lower() not in DUMMIES

    def hidden_in(self, text: str) -> str:
        """Replace the key in ``text`` by ``***``, whether in upper or lower case, percent-encoded or JSON-escaped."""
        return self._spelled.sub(HIDDEN, text) if self.is_secret else text

    @cached_property
    def _spelled(self) -> re.Pattern[str]:
        spellings = (rf"(?:\\{re.escape(c)}|{re.escape(c)}|%{ord(c):02x}|\\u{ord(c):04x})" for c in self._value)
        return re.compile("".join(spellings), re.IGNORECASE)


#: Maximum number of bytes read from a reply.
MAX_BYTES = 4_000_000

#: Headers of a reply that the client uses.
HEADERS = ("retry-after", "retry-after-ms", "x-should-retry")

#: Maximum nesting of a JSON reply; a deeper reply is treated as text.
MAX_DEPTH = 100

#: Maximum absolute value of an integer in a reply; larger integers are replaced by None.
LARGEST = 2**63

#: Exceptions that the client libraries raise on a broken reply, in addition to their own types of errors.
_BROKEN = (ValueError, LookupError, TypeError, AttributeError, OSError, RuntimeError, RecursionError)

_T = TypeVar("_T")


def whole_characters(text: str) -> str:
    """Replace each lone surrogate in ``text`` by U+FFFD; a lone surrogate cannot be encoded as UTF-8."""
    if text.isascii() or not any("\ud800" <= c <= "\udfff" for c in text):
        return text
    return text.encode("utf-16-le", "surrogatepass").decode("utf-16-le", "replace")


class Boundary:
    """Removes the API key and lone surrogates from replies of an endpoint.

    Args:
        secret: key to hide; None: no key.
    """

    def __init__(self, secret: Secret | None) -> None:
        self._secret = secret

    def text(self, text: str) -> str:
        """Return text without the key and without lone surrogates."""
        whole = whole_characters(text)
        return whole if self._secret is None else self._secret.hidden_in(whole)

    def value(self, value: Any, depth: int = 0) -> Any:
        """Return JSON data with cleaned texts; numbers that are not finite or exceed 64 bits become None.

        Raises:
            ValueError: the data is nested too deeply.
        """
        if depth > MAX_DEPTH:
            raise ValueError("too deep")
        if isinstance(value, str):
            return self.text(value)
        if isinstance(value, dict):
            return {self.text(key): self.value(inner, depth + 1) for key, inner in value.items()}
        if isinstance(value, list):
            return [self.value(inner, depth + 1) for inner in value]
        if isinstance(value, float):
            return value if math.isfinite(value) else None
        return value if not isinstance(value, int) or -LARGEST <= value < LARGEST else None

    def body(self, data: bytes) -> tuple[str, bytes]:
        """Return the content type and the cleaned bytes of a reply: JSON if the reply parses as JSON, else text."""
        try:
            return "application/json", json.dumps(self.value(json.loads(data))).encode()
        except (ValueError, RecursionError):
            return "text/plain; charset=utf-8", self.text(data.decode("utf-8", "replace")).encode()


def guarded_client(httpx: Any, boundary: Boundary, timeout: float) -> Any:
    """Return an ``httpx`` client that cleans replies and waits at most ``timeout`` seconds for a complete reply.

    The client follows no redirects because the target may be untrusted.

    Args:
        httpx: the ``httpx`` module, which comes with an optional extra.
        boundary: cleaner of replies and error messages.
        timeout: maximum seconds for one reply, from the DNS lookup to the last byte.
    """
    secure = httpx.create_ssl_context()

    class Guarded(httpx.Client):  # type: ignore[misc]
        def send(self, request: Any, **_: Any) -> Any:
            # Create a client for each attempt, so that closing the client ends only this attempt's connection.
            line = httpx.Client(timeout=timeout, verify=secure, follow_redirects=False)

            def whole() -> tuple[int, Any, bytes]:
                response = line.send(request, stream=True)
                try:
                    return response.status_code, response.headers, _read(httpx, response)
                finally:
                    response.close()

            try:
                status, headers, data = _within(timeout, whole)
            except TimeoutError:
                raise httpx.ReadTimeout("the answer took too long", request=request) from None
            except httpx.RequestError as error:
                raise type(error)(boundary.text(str(error)), request=request) from None
            except (httpx.InvalidURL, *_BROKEN) as error:
                what = f"{type(error).__name__}: {boundary.text(str(error))}"
                raise httpx.RemoteProtocolError(what, request=request) from None
            finally:
                line.close()
            kind, body = boundary.body(data)
            kept = {name: boundary.text(headers[name]) for name in HEADERS if name in headers}
            return httpx.Response(status, headers={**kept, "content-type": kind}, content=body, request=request)

    # Forbid compression, because a small compressed reply could unpack to any size.
    return Guarded(timeout=timeout, headers={"Accept-Encoding": "identity"}, follow_redirects=False)


def _within(seconds: float, act: Callable[[], _T]) -> _T:
    """Run ``act`` in a thread and return its result, or raise TimeoutError after ``seconds``."""
    box: queue.SimpleQueue[tuple[bool, Any]] = queue.SimpleQueue()

    def run() -> None:
        try:
            box.put((True, act()))
        except BaseException as error:  # noqa: BLE001 - it is raised in the thread that waits
            box.put((False, error))

    threading.Thread(target=run, daemon=True, name="a try").start()
    try:
        done, found = box.get(timeout=seconds)
    except queue.Empty:
        raise TimeoutError from None
    if done:
        return found  # type: ignore[no-any-return]
    raise found


def _read(httpx: Any, response: Any) -> bytes:
    """Return the body of a response, cut off after ``MAX_BYTES``."""
    coding = response.headers.get("content-encoding", "identity").strip().lower()
    if coding not in ("", "identity"):
        raise httpx.DecodingError("the answer is compressed, although the request forbids compression")
    data = bytearray()
    for chunk in response.iter_raw():
        data += chunk
        if len(data) >= MAX_BYTES:
            break
    return bytes(data[:MAX_BYTES])

"""Reader of an endpoint's text: within one deadline, of bounded size, without keys or half characters.

All that an endpoint says, answers, refusals, headers and broken protocol, passes :class:`Boundary` before anything
stores, prints or raises it. An endpoint may be broken, or a stranger's.
"""

from __future__ import annotations

import json
import math
import queue
import socket
import threading
from collections.abc import Callable
from typing import Any, TypeVar

from gensim2.design.llm.secret import Secret

#: Bytes of the longest reply of an endpoint that is read; what is beyond is left in the line.
MAX_BYTES = 4_000_000

#: Headers of a reply that anything is made of.
HEADERS = ("retry-after", "retry-after-ms", "x-should-retry")

#: Values inside each other in a reply; more is read as text.
MAX_DEPTH = 100

#: A whole number beyond is none that an endpoint counts.
LARGEST = 2**63

#: What a broken reply makes libraries raise beside their own errors.
_BROKEN = (ValueError, LookupError, TypeError, AttributeError, OSError, RuntimeError, RecursionError)

_T = TypeVar("_T")


def whole_characters(text: str) -> str:
    """Return ``text`` with U+FFFD for each lone surrogate: half a character can neither be written nor sent."""
    if text.isascii() or not any("\ud800" <= c <= "\udfff" for c in text):
        return text
    return text.encode("utf-16-le", "surrogatepass").decode("utf-16-le", "replace")


class Boundary:
    """Cleans what comes in.

    Args:
        secret: what must not come back; None: there is none.
    """

    def __init__(self, secret: Secret | None) -> None:
        self._secret = secret

    def text(self, text: str) -> str:
        """Return text of whole characters without the key."""
        whole = whole_characters(text)
        return whole if self._secret is None else self._secret.hidden_in(whole)

    def value(self, value: Any, depth: int = 0) -> Any:
        """Return plain data with clean text; None for numbers that are not finite or of more than 64 bits.

        Raises:
            ValueError: it is too deep.
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
        """Return content type and bytes of a reply: JSON where it can be read as such, else text."""
        try:
            return "application/json", json.dumps(self.value(json.loads(data))).encode()
        except (ValueError, RecursionError):
            return "text/plain; charset=utf-8", self.text(data.decode("utf-8", "replace")).encode()


def guarded_client(httpx: Any, boundary: Boundary, timeout: float) -> Any:
    """Return an ``httpx`` client whose replies have passed the boundary, each within ``timeout`` seconds as a whole.

    It follows no redirects: another address might be another's.

    Args:
        httpx: the library; it comes with an extra.
        boundary: what replies pass.
        timeout: from the first look for the host's address to the last byte, whatever trickles in meanwhile.
    """

    class Guarded(httpx.Client):  # type: ignore[misc]
        def send(self, request: Any, **given: Any) -> Any:
            line = _Line(httpx)
            request.extensions = {**request.extensions, "trace": line.watch}
            plain = {**given, "stream": True, "follow_redirects": False}

            def whole() -> tuple[int, Any, bytes]:
                response = super(Guarded, self).send(request, **plain)
                try:
                    return response.status_code, response.headers, _read(httpx, response)
                finally:
                    response.close()

            try:
                status, headers, data = _within(timeout, whole, line.cut)
            except TimeoutError:
                raise httpx.ReadTimeout("the answer took too long", request=request) from None
            except httpx.RequestError as error:
                raise type(error)(boundary.text(str(error)), request=request) from None
            except (httpx.InvalidURL, *_BROKEN) as error:
                what = f"{type(error).__name__}: {boundary.text(str(error))}"
                raise httpx.RemoteProtocolError(what, request=request) from None
            kind, body = boundary.body(data)
            kept = {name: boundary.text(headers[name]) for name in HEADERS if name in headers}
            return httpx.Response(status, headers={**kept, "content-type": kind}, content=body, request=request)

    return Guarded(
        timeout=timeout,
        headers={"Accept-Encoding": "identity"},  # what is small on the line stays small
        limits=httpx.Limits(max_keepalive_connections=0),  # a line serves one try, and can be cut with it
        follow_redirects=False,
    )


class _Line:
    """The connection of one try, to be cut from another thread."""

    def __init__(self, httpx: Any) -> None:
        self._httpx = httpx
        self._over = False
        self._sockets: list[socket.socket] = []
        self._lock = threading.Lock()

    def watch(self, event: str, info: dict[str, Any]) -> None:
        """Be told by httpx what happens; a connection that is made too late is given up."""
        if event.endswith((".connect_tcp.complete", ".start_tls.complete")):
            found = info["return_value"].get_extra_info("socket")
            if found is not None:
                with self._lock:
                    self._sockets.append(found)
        if self._over:
            raise self._httpx.ReadTimeout("the answer took too long")

    def cut(self) -> None:
        """End whatever is being read or written."""
        self._over = True
        with self._lock:
            for each in self._sockets:
                try:
                    # Of a socket under TLS, too, the plain one: its own way would wait for the other side.
                    socket.socket.shutdown(each, socket.SHUT_RDWR)
                except OSError:
                    continue  # it is closed already


def _within(seconds: float, act: Callable[[], _T], cut: Callable[[], None]) -> _T:
    """Return what ``act`` does in a thread of its own.

    Raises:
        TimeoutError: it takes longer; then it was ``cut`` and left to itself.
    """
    box: queue.SimpleQueue[tuple[bool, Any]] = queue.SimpleQueue()

    def run() -> None:
        try:
            box.put((True, act()))
        except BaseException as error:  # noqa: BLE001 - it is raised where it is waited for
            box.put((False, error))

    threading.Thread(target=run, daemon=True, name="a try").start()
    try:
        done, found = box.get(timeout=seconds)
    except queue.Empty:
        cut()
        raise TimeoutError from None
    except BaseException:  # Ctrl-C
        cut()
        raise
    if done:
        return found  # type: ignore[no-any-return]
    raise found


def _read(httpx: Any, response: Any) -> bytes:
    """Return the first ``MAX_BYTES`` of a body."""
    coding = response.headers.get("content-encoding", "identity").strip().lower()
    if coding not in ("", "identity"):
        raise httpx.DecodingError("the answer is compressed, though it was asked not to be")
    data = bytearray()
    for chunk in response.iter_raw():
        data += chunk
        if len(data) >= MAX_BYTES:
            break
    return bytes(data[:MAX_BYTES])

"""Untrusted endpoints: repeated, slow, redirected and oversized answers are handled or end as one error.

The servers send raw bytes on loopback, because libraries would not send such answers.
"""

from __future__ import annotations

import gzip
import json
import logging
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Self
from urllib.parse import quote, unquote

import pytest

pytest.importorskip("openai")

from gensim2.core.errors import InputError, ModelError
from gensim2.design.designing import model_designer
from gensim2.design.llm import Asking, LanguageModel, ModelOptions, model_options
from gensim2.design.llm.boundary import HIDDEN, Boundary, Secret
from gensim2.design.llm.client import Client
from gensim2.design.llm.extraction import mappings
from gensim2.design.llm.questions import Message, ModelAnswer, ModelQuestion
from gensim2.design.llm.store import AnswerStore, recorded_answers
from gensim2.design.llm.templating import Prompts
from gensim2.scenes.config import SceneOptions

KEY = "sk-proj-Zq8vT1mWx3nRk5Lb7Yc9"
QUESTION = ModelQuestion("test", "thing", (Message("user", "how are you?"),), {"type": "object"})

Line = socket.socket


class RawServer:
    """Answers each connection with ``act`` in its own thread."""

    def __init__(self, act: Callable[[Line, bytes], None]) -> None:
        self.act, self.requests = act, 0
        self._listening = socket.create_server(("127.0.0.1", 0))
        self._open: list[Line] = []
        self.ended = threading.Semaphore(0)
        threading.Thread(target=self._serve, daemon=True).start()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self._listening.getsockname()[1]}/v1"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._listening.close()
        for line in self._open:
            line.close()

    def _serve(self) -> None:
        while True:
            try:
                line, _ = self._listening.accept()
            except OSError:
                return
            self._open.append(line)
            threading.Thread(target=self._answer, args=(line,), daemon=True).start()

    def _answer(self, line: Line) -> None:
        try:
            data = b""
            while b"\r\n\r\n" not in data:
                data += line.recv(65536)
            head, _, body = data.partition(b"\r\n\r\n")
            length = next((int(r.split(b":")[1]) for r in head.split(b"\r\n") if r.lower().startswith(b"content-l")), 0)
            while len(body) < length:
                body += line.recv(65536)
            self.requests += 1
            self.act(line, body)
        except OSError:
            pass  # the client has left
        finally:
            line.close()
            self.ended.release()


def reply(body: bytes, status: str = "200 OK", headers: bytes = b"") -> Callable[[Line, bytes], None]:
    head = f"HTTP/1.1 {status}\r\nContent-Type: application/json\r\nContent-Length: {len(body)}\r\n".encode()
    return lambda line, _: line.sendall(head + headers + b"\r\n" + body)


def completion(content: object = "fine", **fields: object) -> bytes:
    usage = {"prompt_tokens": 5, "completion_tokens": 3, "total_tokens": 8}
    message = {"role": "assistant", "content": content}
    choice = {"index": 0, "message": message, "finish_reason": "stop"}
    body = {"id": "c", "object": "chat.completion", "created": 0, "model": "m", "choices": [choice], "usage": usage}
    return json.dumps({**body, **fields}).encode()


@pytest.fixture(autouse=True)
def key(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    monkeypatch.delenv("OPENAI_BASE_URL", raising=False)
    monkeypatch.setattr("openai._base_client.INITIAL_RETRY_DELAY", 0.01)


@pytest.fixture
def serve() -> Iterator[Callable[[Callable[[Line, bytes], None]], RawServer]]:
    servers: list[RawServer] = []

    def start(act: Callable[[Line, bytes], None]) -> RawServer:
        servers.append(RawServer(act))
        return servers[-1]

    yield start
    for server in servers:
        server.__exit__()


Serve = Callable[[Callable[[Line, bytes], None]], RawServer]


def options(server: RawServer, **given: Any) -> ModelOptions:
    return ModelOptions(**{"model": "m", "base_url": server.url, "timeout": 5.0, "retries": 0, **given})


def ask(server: RawServer, **given: Any) -> ModelAnswer:
    return Client(options(server, **given)).ask(QUESTION)


# Row 3: the cache of answers


def test_another_endpoint_is_another_question(serve: Serve, tmp_path: Path) -> None:
    servers = [serve(reply(completion(f"the {name} server"))) for name in ("first", "second")]
    for _ in range(2):
        for server, name in zip(servers, ("first", "second"), strict=True):
            answer = LanguageModel(options(server), cache=tmp_path / "cache").answer(QUESTION)
            assert answer.text == f"the {name} server"
    assert [server.requests for server in servers] == [1, 1]


@pytest.mark.parametrize(
    "given",
    [{"model": "n"}, {"temperature": 0.5}, {"max_tokens": 100}, {"structured": "off"}],
    ids=lambda g: next(iter(g)),
)
def test_other_parameters_are_another_question(serve: Serve, tmp_path: Path, given: dict[str, Any]) -> None:
    server = serve(reply(completion()))
    for fields in ({}, given, given):
        LanguageModel(options(server, **fields), cache=tmp_path / "cache").answer(QUESTION)
    assert server.requests == 2
    other = replace(QUESTION, schema={"type": "array"})
    LanguageModel(options(server), cache=tmp_path / "cache").answer(other)
    assert server.requests == 3


def test_a_folder_holds_the_answers_of_one_endpoint(serve: Serve, tmp_path: Path) -> None:
    first, second = serve(reply(completion())), serve(reply(completion()))
    LanguageModel(options(first)).open(tmp_path / "run")
    with pytest.raises(InputError, match=r"endpoint: contains answers from the endpoint .*, but this run uses "):
        LanguageModel(options(second)).open(tmp_path / "run")


def test_a_folder_without_an_endpoint_is_gone_on_with(serve: Serve, tmp_path: Path) -> None:
    """Folders of earlier versions without an endpoint can be continued."""
    server = serve(reply(completion()))
    LanguageModel(options(server)).open(tmp_path / "run")
    file = tmp_path / "run" / "model.json"
    kept = json.loads(file.read_text())
    del kept["endpoint"]
    file.write_text(json.dumps(kept))
    LanguageModel(options(server)).open(tmp_path / "run")
    assert LanguageModel(options(server), replay=tmp_path / "run").options.model == "m"


#: Output of version 0.2.0 with --record.
RECORD_OF_0_2_0 = {
    "model.json": {
        "schema_version": 1, "model": "m", "temperature": None, "max_tokens": 4096, "price_in": None, "price_out": None,
        "budget": None, "prompts": "", "asking": {"mode": "explore", "trials": 2},
    },
    "answers/{}.json": {
        "schema_version": 1, "stage": "test", "subject": "Task", "messages": [{"role": "user", "text": "?"}],
        "text": "as recorded", "problem": None, "tokens_in": 5, "tokens_out": 3, "counted": True, "retries": 0,
        "cost": None, "spent": None,
    },
}  # fmt: skip


def test_a_record_of_version_0_2_0_is_replayed(tmp_path: Path) -> None:
    digest = QUESTION.digest("m", None, 4096)[:32]
    for name, content in RECORD_OF_0_2_0.items():
        file = tmp_path / "tape" / name.format(digest)
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(content))
    assert recorded_answers(tmp_path / "tape") == tmp_path / "tape"
    recorded = AnswerStore(tmp_path / "tape").model()
    assert Asking.read(recorded.asking, tmp_path / "tape").trials == 2
    replayed = LanguageModel(recorded.options, replay=tmp_path / "tape")
    replayed.open(tmp_path / "run" / "model")
    assert replayed.answer(QUESTION).text == "as recorded"
    assert recorded_answers(tmp_path / "run") == tmp_path / "run" / "model"


# Row 4: the server sends the key back


ECHOES = {
    "a refusal": (f"you, {KEY}, may not", 400),
    "a wrong key": (f"Incorrect API key provided: {KEY}", 401),
    "a wrong model": (f"no model for Bearer {KEY}", 404),
    "a rate limit": (f"{KEY} asks too often", 429),
    "a server error": (f"crashed on {KEY}", 500),
    "in capitals": (f"HEADER {KEY.upper()}", 400),
    "percent-encoded": (f"no /?key={''.join(f'%{ord(c):02X}' for c in KEY)}&", 400),
}


def kept_of_key(text: str) -> list[str]:
    """Return the parts of a text that contain the key, in plain or percent-encoded form, in upper or lower case."""
    return [KEY] if KEY.lower() in unquote(text).lower() else []


@pytest.mark.parametrize("name", ECHOES)
@pytest.mark.parametrize("shape", ["message", "text", "header", "reason", "escaped"])
def test_a_key_that_is_repeated_in_a_refusal_is_in_no_message(
    serve: Serve, caplog: pytest.LogCaptureFixture, name: str, shape: str
) -> None:
    caplog.set_level(logging.DEBUG)
    said, status = ECHOES[name]
    body, reason, headers = json.dumps({"error": {"message": said}}).encode(), "Refused", b""
    if shape == "text":
        body = said.encode()
    elif shape == "header":
        headers = f"X-Request-Id: {said}\r\nRetry-After: {said}\r\nSet-Cookie: {said}\r\n".encode()
    elif shape == "reason":
        reason = said
    elif shape == "escaped":
        body = ('{"error": {"message": "' + "".join(f"\\u{ord(c):04x}" for c in said) + '"}}').encode()
    server = serve(reply(body, f"{status} {reason}", headers))
    with pytest.raises((InputError, ModelError)) as refused:
        ask(server)
    chain = []
    error: BaseException | None = refused.value
    while error is not None:
        chain.append(f"{error!r} {error}")
        error = error.__cause__
    assert kept_of_key(" ".join([*chain, caplog.text])) == []
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("broken", [f"X-Key {KEY}\r\n", f"{KEY}: x\x00y\r\n", f"Content-Length: {KEY}\r\n"])
def test_a_key_in_a_broken_protocol_is_in_no_message(serve: Serve, broken: str) -> None:
    def act(line: Line, _: bytes) -> None:
        line.sendall(b"HTTP/1.1 200 OK\r\n" + broken.encode() + b"\r\n")

    with pytest.raises(ModelError) as refused:
        ask(serve(act))
    error: BaseException | None = refused.value
    while error is not None:
        assert kept_of_key(str(error)) == []
        error = error.__cause__


def test_a_key_in_an_answer_is_in_no_file(serve: Serve, tmp_path: Path) -> None:
    bodies = [
        completion(f'{{"fine": "{KEY}"}}'),
        completion(f"{KEY} " * 3, usage={"prompt_tokens": KEY, KEY: 1}),
        completion(None, choices=[{"index": 0, "message": {"content": None, "refusal": f"no, {KEY}"}}]),
    ]
    for number, body in enumerate(bodies):
        asked = replace(QUESTION, sample=(number,))
        model = LanguageModel(options(serve(reply(body))), cache=tmp_path / "cache")
        model.open(tmp_path / f"run{number}")
        answer = model.answer(asked)
        assert kept_of_key(repr(answer)) == []
        assert HIDDEN in f"{answer.text} {answer.problem}"
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert len(files) == 3 * 2 + 2, "model.json and an answer of each run, and those of the cache"
    assert [path for path in files if kept_of_key(path.read_text())] == []


def test_a_key_shows_itself_nowhere() -> None:
    secret = Secret(KEY)
    assert (repr(secret), str(secret), f"{secret}", repr([secret])) == (HIDDEN, HIDDEN, HIDDEN, f"[{HIDDEN}]")
    assert secret.reveal() == KEY


# Row 5: text that is not secret


@pytest.mark.parametrize(
    "dummy",
    [
        "x",
        "EMPTY",
        "none",
        "sk-no-key-required",
        "not-needed",
        "lm-studio",
        "ollama",
    ],
)
def test_a_dummy_is_no_secret(serve: Serve, monkeypatch: pytest.MonkeyPatch, dummy: str) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", dummy)
    said = f"the fox's next box is EMPTY; none of the {dummy} is not-needed"
    assert ask(serve(reply(completion(said)))).text == said


@pytest.mark.parametrize(
    "key",
    [
        KEY,
        "sk-wrong-abcdefg",
        "token-abc123",
        "Pa55word!",
        "0123456789abcdef0123456789abcdef",
        "correct-horse-battery-staple",
        "AIzaSyA1b2C3d4E5f6",
    ],
)
def test_a_key_is_a_secret(key: str) -> None:
    assert Secret(key).hidden_in(f"<{key}> and Bearer {key}.") == f"<{HIDDEN}> and Bearer {HIDDEN}."


@pytest.mark.parametrize(
    "spelled",
    [
        KEY.upper(),
        quote(KEY, safe=""),
        "".join(f"%{ord(c):02X}" for c in KEY),
        "".join(f"\\u{ord(c):04x}" for c in KEY),
        KEY[:4] + "".join(f"\\u{ord(c):04X}" for c in KEY[4:]),
        json.dumps(KEY)[1:-1],
    ],
)
def test_a_key_in_another_spelling_is_hidden(spelled: str) -> None:
    assert Secret(KEY).hidden_in(f"<{spelled}> {spelled}") == f"<{HIDDEN}> {HIDDEN}"


@pytest.mark.parametrize("key", ['Pa"55/word\\', "a+b/c=d%e1234", "(.*){9}[x]1"])
def test_a_key_with_signs_is_hidden_in_json_and_in_an_address(key: str) -> None:
    text = f"{key} {json.dumps(key)} {quote(key, safe='')}"
    assert Secret(key).hidden_in(text) == f'{HIDDEN} "{HIDDEN}" {HIDDEN}'


# Row 6: lone surrogates


def test_half_a_character_is_mended_before_it_is_stored(serve: Serve, tmp_path: Path) -> None:
    body = completion("half \ud800 a character, a whole \U0001f600 one")
    assert b"\\ud800" in body
    for run in ("one", "two"):
        model = LanguageModel(options(serve(reply(body))), cache=tmp_path / "cache")
        model.open(tmp_path / run)
        assert model.answer(QUESTION).text == "half \ufffd a character, a whole \U0001f600 one"
        again = LanguageModel(options(serve(reply(body))), replay=tmp_path / run)
        assert again.answer(QUESTION).text == model.answer(QUESTION).text


@pytest.mark.parametrize("body", [b'"\xed\xa0\x80"', b"\xff\xfe\x00\xd8", b'{"choices": "\\udc00"}', b"\xed\xb0\x80"])
def test_bytes_that_are_half_a_character_are_no_crash(serve: Serve, body: bytes) -> None:
    assert ask(serve(reply(body))).problem == "it could not be read as a chat completion"


@pytest.mark.parametrize(
    "text",
    [r'{"a": "\ud800"}', r'{"a": ["x", {"b": "\udfff"}],}', r'{"\ud800": 1, }', r'a: "\ud800"', r'{a: "\ud800"'],
)
def test_half_a_character_in_the_data_of_an_answer_is_refused(text: str) -> None:
    with pytest.raises(
        InputError, match=r"an unpaired surrogate|an unpaired UTF-16 surrogate|invalid Unicode character escape"
    ):
        mappings(text)


POISON = {
    "a lone surrogate": lambda data: data.replace(b'"fine"', b'"\\ud800"'),
    "cut": lambda data: data[:-30],
    "empty": lambda data: b"",
    "another shape": lambda data: b"[]",
    "no text": lambda data: b"\xff\xfe\x00\xd8",
    "deep": lambda data: b"[" * 100_000,
    "a wild number": lambda data: data.replace(b'"tokens_in": 5', b'"tokens_in": 1' + b"0" * 5000),
}


@pytest.mark.parametrize("name", POISON)
def test_a_poisoned_entry_of_the_cache_is_asked_again_and_replaced(serve: Serve, tmp_path: Path, name: str) -> None:
    server = serve(reply(completion()))
    LanguageModel(options(server), cache=tmp_path).answer(QUESTION)
    (entry,) = (tmp_path / "answers").iterdir()
    whole = entry.read_bytes()
    entry.write_bytes(POISON[name](whole))
    assert entry.read_bytes() != whole
    for _ in range(2):
        assert LanguageModel(options(server), cache=tmp_path).answer(QUESTION).text == "fine"
    assert server.requests == 2
    assert entry.read_bytes() == whole


def test_a_pipe_in_the_cache_or_in_a_run_is_never_opened(serve: Serve, tmp_path: Path) -> None:
    server = serve(reply(completion()))
    model = LanguageModel(options(server), cache=tmp_path / "cache")
    model.open(tmp_path / "run")
    model.answer(QUESTION)
    for folder in ("cache", "run"):
        (entry,) = (tmp_path / folder / "answers").iterdir()
        entry.unlink()
        os.mkfifo(entry)
    assert LanguageModel(options(server), cache=tmp_path / "cache").answer(QUESTION).text == "fine"
    with pytest.raises(InputError, match="is a pipe, not a file"):
        LanguageModel(options(server), replay=tmp_path / "run").answer(QUESTION)
    (tmp_path / "run" / "model.json").unlink()
    os.mkfifo(tmp_path / "run" / "model.json")
    with pytest.raises(InputError, match="is a pipe, not a file"):
        AnswerStore(tmp_path / "run").model()


# Row 7: deadlines, numbers, redirects


def drip(head: bytes, drops: bytes, *, every: float = 0.1) -> Callable[[Line, bytes], None]:
    def act(line: Line, _: bytes) -> None:
        line.sendall(head)
        for _ in range(300):
            line.sendall(drops)
            time.sleep(every)

    return act


DRIPS = {
    "header lines": drip(b"HTTP/1.1 200 OK\r\n", b"X-Wait: 1\r\n"),
    "one header": drip(b"HTTP/1.1 200 OK\r\nX-Wait: ", b"1"),
    "the status line": drip(b"HTTP/1.1 200 ", b"O"),
    "informational replies": drip(b"", b"HTTP/1.1 103 Early Hints\r\n\r\n"),
    "the body": drip(b"HTTP/1.1 200 OK\r\nContent-Length: 100000\r\n\r\n", b"{"),
    "chunks": drip(b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n", b"1\r\n{\r\n"),
    "a chunk's name": drip(b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n1;", b"x"),
    "a refusal": drip(b"HTTP/1.1 400 Bad\r\nContent-Length: 100000\r\n\r\n", b"{"),
    "nothing": drip(b"", b""),
}


@pytest.mark.parametrize("name", DRIPS)
def test_a_try_has_one_deadline_whatever_trickles_in(serve: Serve, name: str) -> None:
    server = serve(DRIPS[name])
    begin = time.monotonic()
    with pytest.raises(ModelError, match=r"no answer within 0\.5 s, tried once"):
        ask(server, timeout=0.5)
    assert time.monotonic() - begin < 3.0
    if name != "nothing":  # otherwise the server got no request
        assert server.ended.acquire(timeout=5.0), "the connection is cut"
    assert [each.name for each in _tries() if _stays(each)] == []


def _tries() -> list[threading.Thread]:
    return [each for each in threading.enumerate() if each.name == "a try"]


def _stays(thread: threading.Thread) -> bool:
    thread.join(5.0)
    return thread.is_alive()


@pytest.mark.parametrize("count", [10**310, "10**5000", -1, 2.5, 1e300, None, [], 10**18], ids=lambda c: repr(c)[:8])
def test_wild_counts_of_tokens_are_estimated(serve: Serve, tmp_path: Path, count: object) -> None:
    word = b"1" + b"0" * 5000 if count == "10**5000" else json.dumps(count).encode()
    body = completion().replace(b'"prompt_tokens": 5', b'"prompt_tokens": ' + word)
    server = serve(reply(body))
    model = LanguageModel(options(server, price_in=1e6, price_out=1e6))
    model.open(tmp_path)
    answer = model.answer(QUESTION)
    assert not answer.counted
    assert 0 < answer.tokens_in < 1000
    assert LanguageModel(options(server), replay=tmp_path).answer(QUESTION) == answer


@pytest.mark.parametrize("word", [b"NaN", b"Infinity", b"-Infinity", b"1e999"])
def test_counts_that_are_no_numbers_are_estimated(serve: Serve, word: bytes) -> None:
    body = completion().replace(b'"prompt_tokens": 5', b'"prompt_tokens": ' + word)
    answer = ask(serve(reply(body)))
    assert (answer.text, answer.counted) == ("fine", False)


@pytest.mark.parametrize("status", ["301 Moved", "302 Found", "303 See", "307 Temporary", "308 Permanent"])
@pytest.mark.parametrize("where", ["another host", "the same host", "a file", "nowhere"])
def test_no_redirect_is_followed(serve: Serve, status: str, where: str) -> None:
    other = serve(reply(completion("of another host")))
    name = other.url.replace("127.0.0.1", "localhost")
    target = {"another host": name, "the same host": "/v1/x", "a file": "file:///etc/passwd", "nowhere": "http://[/"}[
        where
    ]
    server = serve(reply(b"", status, f"Location: {target}\r\n".encode()))
    with pytest.raises(InputError, match=r"redirects to another address .*--base-url"):
        ask(server)
    assert other.requests == 0
    assert server.requests == 1


# Similar cases


def test_a_compressed_bomb_is_not_unpacked(serve: Serve) -> None:
    body = gzip.compress(b" " * 30_000_000, 1)
    begin = time.process_time()
    with pytest.raises(ModelError, match="compressed"):
        ask(serve(reply(body, headers=b"Content-Encoding: gzip\r\n")))
    assert time.process_time() - begin < 1.0


def test_a_message_is_one_line_without_control_characters(serve: Serve) -> None:
    body = json.dumps({"error": {"message": "a\x1b[31m\r\nb" + "c" * 100_000}}).encode()
    for status in ("400 Bad", "500 Bad", "429 Bad", "404 Bad"):
        with pytest.raises((InputError, ModelError)) as refused:
            ask(serve(reply(body, status)))
        assert str(refused.value).isprintable()
        assert len(str(refused.value)) < 2000


def test_an_endless_refusal_is_short(serve: Serve) -> None:
    choice = {"index": 0, "message": {"role": "assistant", "content": "", "refusal": "no " * 100_000}}
    problem = ask(serve(reply(completion(choices=[choice])))).problem
    assert problem is not None
    assert problem.startswith("it was empty (no no")
    assert len(problem) < 400


def test_a_deep_reply_is_no_crash(serve: Serve) -> None:
    for body in (b"[" * 1_000_000, b'{"a":' * 500_000, b"[" * 500 + b"]" * 500):
        assert ask(serve(reply(body))).problem == "it could not be read as a chat completion"


def test_an_address_in_the_environment_is_checked_as_any(monkeypatch: pytest.MonkeyPatch) -> None:
    for address in (
        "http://user:Zq8vT1mWx3nRk5@127.0.0.1:9/v1",
        "ftp://x",
        "http://h:99999/v1",
        "http://[/",
        "http://h/?key=Zq8vT1mWx3nRk5",
    ):
        monkeypatch.setenv("OPENAI_BASE_URL", address)
        with pytest.raises(InputError, match=r"\$OPENAI_BASE_URL: ") as refused:
            Client(ModelOptions(model="m"))
        assert "Zq8vT1mWx3nRk5" not in str(refused.value)


def test_a_proxy_that_is_none_is_one_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HTTP_PROXY", "foo://user:Zq8vT1mWx3nRk5@127.0.0.1:9")
    with pytest.raises(InputError, match="no connection to the model can be made") as refused:
        Client(ModelOptions(model="m", base_url="http://127.0.0.1:9/v1"))
    assert "Zq8vT1mWx3nRk5" not in str(refused.value)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("max_tokens", 5),
        ("max_tokens", 10**30),
        ("model", ""),
        ("temperature", 1e308),
        ("asking", {"wish": 1}),
        ("asking", {"trials": "many"}),
        ("asking", {"mode": "sideways"}),
        ("budget", 1.0),
        ("prompts", 5),
    ],
)
def test_a_damaged_record_is_one_error(serve: Serve, tmp_path: Path, field: str, value: object) -> None:
    LanguageModel(options(serve(reply(completion())))).open(tmp_path)
    file = tmp_path / "model.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), field: value}))

    def read() -> tuple[Asking, ModelOptions]:
        recorded = AnswerStore(tmp_path).model()
        return Asking.read(recorded.asking, tmp_path), recorded.options

    with pytest.raises(InputError, match=field):
        read()


@pytest.mark.parametrize(
    "text",
    ["{{ 1 / 0 }}", "{% include 'system.md.j2' %}", "{{ 'a' * 10**13 }}", "{{ range(10**9) }}", "{{ [1] < 'a' }}"],
)
def test_prompts_of_ones_own_that_cannot_be_filled_in_are_one_error(tmp_path: Path, text: str) -> None:
    (tmp_path / "system.md.j2").write_text(text)
    with pytest.raises(InputError, match=r"system\.md\.j2: the template cannot be filled in: \S"):
        Prompts(tmp_path).text("system")


def test_a_pipe_among_prompts_is_never_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "system.md.j2")
    with pytest.raises(InputError, match="is a pipe"):
        Prompts(tmp_path)


def test_a_prompt_of_a_terabyte_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "system.md.j2").touch()
    os.truncate(tmp_path / "system.md.j2", 2**40)
    with pytest.raises(InputError, match=r"system\.md\.j2: is larger than 1 MiB"):
        Prompts(tmp_path)


def test_a_run_is_replayed_with_its_own_prompts_only(serve: Serve, tmp_path: Path) -> None:
    LanguageModel(options(serve(reply(completion()))), Prompts().digest).open(tmp_path / "run" / "model")
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "system.md.j2").write_text("Be brief.")
    with pytest.raises(InputError, match=r"run.*: the recorded run used different prompts .*--prompts"):
        model_designer(None, Asking(), SceneOptions("builtin"), prompts=tmp_path / "own", replay=tmp_path / "run")


def test_the_boundary_leaves_plain_data_as_it_is() -> None:
    value = {"a": [1, 2.5, None, True, "text"], "b": {"c": -(2**63)}}
    assert Boundary(Secret(KEY)).value(value) == value
    assert Boundary(None).text("\U0001f600") == "\U0001f600"
    assert model_options(model="m").key is not None

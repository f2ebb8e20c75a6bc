"""The client over real HTTP on loopback: each fault ends in a retry, an answer with a problem, or one clear error."""

from __future__ import annotations

import json
import logging
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("openai")

from llm_server import (
    CUT,
    HALF_A_BODY,
    KEY,
    NO_SCHEMA,
    RATE_LIMIT,
    RATE_LIMIT_WAIT,
    SERVER_ERROR,
    Fault,
    ModelServer,
)

from gensim2.core.errors import InputError, ModelError
from gensim2.design.llm import LanguageModel, ModelOptions
from gensim2.design.llm.boundary import MAX_BYTES
from gensim2.design.llm.client import Client
from gensim2.design.llm.questions import BudgetSpent, Message, ModelQuestion
from gensim2.design.pictures import LazyPicture

PNG = b"\x89PNG\r\n\x1a\n" + b"0" * 20


@pytest.fixture
def server() -> Iterator[ModelServer]:
    with ModelServer(lambda asked: '{"fine": true}') as found:
        yield found


def options(server: ModelServer, **given: Any) -> ModelOptions:
    fields = {"model": "test-model", "base_url": server.url, "timeout": 5.0, "retries": 2, **given}
    return ModelOptions(**fields)


def question(text: str = "# Test\nhow are you?", pictures: tuple[LazyPicture, ...] = ()) -> ModelQuestion:
    said = (Message("system", "be good"), Message("user", text, pictures))
    return ModelQuestion("test", "thing", said, {"type": "object"})


def test_an_answer_comes_with_its_tokens_and_cost(server: ModelServer) -> None:
    answer = Client(options(server, price_in=1.0, price_out=2.0)).ask(question())
    assert (answer.text, answer.problem, answer.retries, answer.counted) == ('{"fine": true}', None, 0, True)
    assert answer.cost == pytest.approx((answer.tokens_in * 1.0 + answer.tokens_out * 2.0) / 1e6)
    body = server.asked[0].body
    assert body["response_format"]["json_schema"]["schema"] == {"type": "object"}
    assert body["max_tokens"] == 4096
    assert "temperature" not in body


@pytest.mark.parametrize("fault", [RATE_LIMIT, RATE_LIMIT_WAIT, SERVER_ERROR, CUT], ids=lambda f: str(f.status))
def test_what_passes_is_tried_again(server: ModelServer, fault: Fault) -> None:
    server.faults = deque([fault, fault])
    answer = Client(options(server)).ask(question())
    assert (answer.text, answer.retries) == ('{"fine": true}', 2)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (RATE_LIMIT, "limits the request rate, tried 3 times"),
        (SERVER_ERROR, "tried 3 times"),
        (CUT, "cannot be reached, tried 3 times"),
    ],
)
def test_what_does_not_pass_is_one_error(server: ModelServer, fault: Fault, words: str) -> None:
    server.faults = deque([fault] * 3)
    with pytest.raises(ModelError, match=words):
        Client(options(server, structured="off")).ask(question())
    assert server.requests == 3


def test_an_endpoint_that_hangs_is_timed_out_and_tried_again(server: ModelServer) -> None:
    server.faults = deque([Fault(hang=0.6)])
    answer = Client(options(server, timeout=0.25)).ask(question())
    assert (answer.text, answer.retries) == ('{"fine": true}', 1)
    server.faults = deque([Fault(hang=0.6)])
    with pytest.raises(ModelError, match=r"no answer within 0\.25 s, tried once; .* larger timeout"):
        Client(options(server, timeout=0.25, retries=0)).ask(question())


def test_nobody_there_is_one_error() -> None:
    gone = ModelOptions(model="m", base_url="http://127.0.0.1:9/v1", retries=0, timeout=2.0)
    with pytest.raises(ModelError, match="cannot be reached, tried once"):
        Client(gone).ask(question())


@pytest.mark.parametrize("body", [HALF_A_BODY.body, b"[]", b"{}", b'{"choices": []}', b"\xff\xfe", b"<html>"])
def test_what_is_no_chat_completion_is_an_answer_with_a_problem(server: ModelServer, body: bytes) -> None:
    server.faults = deque([Fault(body=body)])
    answer = Client(options(server)).ask(question())
    assert answer.problem == "it could not be read as a chat completion"
    assert answer.text == ""


def test_ten_megabytes_are_not_read_to_the_end(server: ModelServer) -> None:
    server.script = lambda asked: "x" * 10_000_000
    answer = Client(options(server)).ask(question())
    assert answer.problem == "it could not be read as a chat completion"
    assert MAX_BYTES < 10_000_000


def test_an_answer_that_was_cut_off_says_so(server: ModelServer) -> None:
    server.finish = "length"
    assert Client(options(server)).ask(question()).problem == "it was cut off because it was too long"


def test_an_empty_answer_says_so(server: ModelServer) -> None:
    server.script = lambda asked: "  \n"
    assert Client(options(server)).ask(question()).problem == "it was empty"


def test_an_endpoint_without_schemas_is_asked_without(server: ModelServer) -> None:
    server.faults = deque([NO_SCHEMA])
    client = Client(options(server))
    assert client.ask(question()).text == '{"fine": true}'
    assert client.ask(question()).text == '{"fine": true}'
    assert server.requests == 3
    assert all("response_format" not in asked.body for asked in server.asked)


def test_a_server_that_fails_on_a_schema_is_asked_without(server: ModelServer) -> None:
    server.broken = lambda body: "response_format" in body
    client = Client(options(server))
    assert client.ask(question()).text == '{"fine": true}'
    assert server.requests == 4, "three attempts with a schema and one without"
    assert client.ask(question()).text == '{"fine": true}'
    assert server.requests == 5, "later questions go without at once"


def test_a_server_that_fails_on_everything_is_one_error(server: ModelServer) -> None:
    server.broken = lambda body: True
    with pytest.raises(ModelError, match="made to fail"):
        Client(options(server)).ask(question())
    assert server.requests == 6


def test_a_server_that_refuses_a_field_as_unprocessable_is_asked_without(server: ModelServer) -> None:
    refused = b'{"detail": [{"type": "extra_forbidden", "loc": ["body", "response_format"]}]}'
    server.faults = deque([Fault(422, body=refused)])
    assert Client(options(server)).ask(question()).text == '{"fine": true}'
    assert "response_format" not in server.asked[-1].body


def test_nothing_at_the_address_is_no_missing_model(server: ModelServer) -> None:
    server.faults = deque([Fault(404, body=b'{"detail": "Not Found"}')])
    with pytest.raises(InputError, match="the end of --base-url"):
        Client(options(server)).ask(question())


def test_a_model_with_another_name_for_the_limit_is_asked_by_it(server: ModelServer) -> None:
    complaint = b'{"error": {"message": "max_tokens is not supported, use max_completion_tokens"}}'
    server.faults = deque([Fault(400, body=complaint)])
    Client(options(server)).ask(question())
    assert server.asked[0].body["max_completion_tokens"] == 4096


def test_any_other_refusal_is_one_error(server: ModelServer) -> None:
    server.faults = deque([Fault(400, body=b'{"error": {"message": "content policy"}}')])
    with pytest.raises(InputError, match=r"refuses the request.*content policy"):
        Client(options(server)).ask(question())
    assert server.requests == 1


@pytest.mark.parametrize("complaint", ["maximum context length is 8192 tokens", "exceeds the available context size"])
def test_a_prompt_beyond_the_context_names_the_remedy(server: ModelServer, complaint: str) -> None:
    server.faults = deque([Fault(400, body=json.dumps({"error": {"message": complaint}}).encode())])
    with pytest.raises(InputError, match="with a longer context, or choose another model"):
        Client(options(server)).ask(question())


def test_a_key_is_named_by_its_variable_and_never_said(
    server: ModelServer, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    secret = "sk-wrong-abcdefg"
    monkeypatch.setenv("OPENAI_API_KEY", secret)
    caplog.set_level(logging.DEBUG)
    client = Client(options(server))
    with pytest.raises(InputError, match="OPENAI_API_KEY: holds a key that is refused") as refused:
        client.ask(question())
    server.key, server.script = None, lambda asked: f"your key is {secret}"
    answer = client.ask(question())
    server.faults = deque([Fault(400, body=f'{{"error": {{"message": "key {secret}"}}}}'.encode())])
    with pytest.raises(InputError) as other:
        client.ask(question())
    assert secret not in f"{refused.value} {other.value} {answer} {caplog.text}"
    assert "***" in answer.text


def test_no_key_is_said(server: ModelServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OPENAI_API_KEY")
    with pytest.raises(InputError, match="OPENAI_API_KEY: is not set"):
        Client(options(server)).ask(question())


def test_pictures_go_along_as_data(server: ModelServer) -> None:
    Client(options(server)).ask(question(pictures=(LazyPicture("a thing", lambda: PNG),)))
    assert server.asked[0].pictures == (PNG,)
    with pytest.raises(InputError, match="no PNG"):
        Client(options(server)).ask(question(pictures=(LazyPicture("no picture", lambda: b"GIF89a"),)))


def test_a_question_is_asked_once_in_a_run_and_in_all_runs(server: ModelServer, tmp_path: Path) -> None:
    for run in ("one", "two"):
        for _ in range(2):  # the second one is resumed
            model = LanguageModel(options(server, price_in=1.0, price_out=1.0), cache=tmp_path / "cache")
            model.open(tmp_path / run)
            assert model.answer(question()).text == '{"fine": true}'
            assert model.ledger.account.answers == 1
    assert server.requests == 1
    assert model.ledger.account.asked == 0
    assert KEY not in "".join(path.read_text() for path in tmp_path.rglob("*.json"))


def test_a_run_is_recorded_and_replayed_without_a_model(server: ModelServer, tmp_path: Path) -> None:
    model = LanguageModel(options(server))
    model.open(tmp_path / "run")
    asked = model.answer(question())
    replayed = LanguageModel(options(server), replay=tmp_path / "run")
    assert replayed.answer(question()) == asked
    replayed.open(tmp_path / "again")
    assert replayed.answer(question()) == asked
    assert LanguageModel(options(server), replay=tmp_path / "again").answer(question()) == asked, "a replay is replayed"
    with pytest.raises(InputError, match=r"run.*holds no answer to this question of the stage test"):
        replayed.answer(question("# Test\nanother"))
    (file,) = (tmp_path / "run" / "answers").iterdir()
    file.write_text(file.read_text()[:-20])
    with pytest.raises(InputError, match="line 21: is not valid JSON"):
        LanguageModel(options(server), replay=tmp_path / "run").answer(question())


def test_the_budget_ends_asking_before_it_is_overdrawn(server: ModelServer, tmp_path: Path) -> None:
    given = options(server, price_in=10.0, price_out=10.0, max_tokens=100, budget=0.0012)
    model = LanguageModel(given)
    model.open(tmp_path)
    for number in range(2):
        model.answer(question(f"# Test\nquestion {number}"))
    third = question("# Test\nquestion 2")
    with pytest.raises(BudgetSpent, match=r"of 0\.0012 USD are spent"):
        model.answer(third)
    cost = model.ledger.account.cost
    assert cost is not None
    assert 0 < cost <= 0.0012
    assert server.requests == 2
    with pytest.raises(BudgetSpent):
        LanguageModel(given, replay=tmp_path).answer(third)
    richer = LanguageModel(options(server, price_in=10.0, price_out=10.0, max_tokens=100, budget=1.0))
    richer.open(tmp_path)
    assert richer.answer(third).problem is None, "a resumed run with more to spend asks"


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"base_url": "ftp://x"}, "no http or https address"),
        ({"base_url": "http://user:pass@host/v1"}, "the key comes from the environment"),
        ({"budget": 1.0}, "requires price_in and price_out"),
        ({"temperature": 5.0}, "temperature: input should be less than or equal to 2"),
        ({"temprature": 1.0}, "temprature: unknown field"),
    ],
)
def test_options_that_cannot_be_used_are_named(tmp_path: Path, fields: dict[str, Any], words: str) -> None:
    from gensim2.design.llm import model_options

    file = tmp_path / "model.yaml"
    file.write_text(json.dumps({"model": "m", **fields}))
    with pytest.raises(InputError, match=words):
        model_options(file)

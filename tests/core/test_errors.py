"""Every error is shown as one printable line."""

from __future__ import annotations

import pickle
from io import StringIO
from typing import Annotated, Any, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from gensim2.core.errors import LONGEST_WORD, InputError, brief, one_line
from gensim2.core.progress import ConsoleProgress
from gensim2.core.validation import input_error


def test_line_breaks_and_control_characters_do_not_come_through() -> None:
    assert one_line("a\nb\r\n\tc") == "a b c"
    assert one_line("a\x1b[31mb\x00") == "a\\x1b[31mb\\x00"
    assert one_line("\ud800\u202e") == "\\ud800\\u202e"
    assert one_line("Größe × 2") == "Größe × 2"


def test_long_words_are_shortened_and_say_how_long_they_are() -> None:
    path = "/" + "a" * (LONGEST_WORD - 1)
    assert one_line(f"{path}: no") == f"{path}: no"
    shown = one_line(f"is '{'9' * 5000}', too large")
    assert shown.startswith("is '9999")
    assert shown.endswith("9999 (5000 characters)', too large")
    assert len(shown) < 120


def test_numbers_that_python_does_not_write() -> None:
    assert brief(-12) == "-12"
    assert brief(10**5000) == "a number of 16610 bits"


@given(st.text(), st.text(), st.text())
def test_an_error_is_one_line(message: str, field: str, remedy: str) -> None:
    error = InputError(message, file="a.yaml", field=field, remedy=remedy)
    assert len(str(error).splitlines()) == 1
    assert str(error).isprintable()
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


class Box(BaseModel):
    model_config = ConfigDict(extra="forbid")

    width: Annotated[float, Field(gt=0)] = 1.0
    lid: Literal["Hinged", "Sliding"] = "Hinged"
    name: str = "box"

    @field_validator("name")
    @classmethod
    def _is_short(cls, name: str) -> str:
        if len(name) > 3:
            raise ValueError("has more than 3 letters")
        return name


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"width": -1}, "box.json: line 2: width: input should be greater than 0 (see the docs)"),
        ({"lid": "hinged"}, "box.json: line 2: lid: input should be 'Hinged' or 'Sliding' (see the docs)"),
        ({"name": "crate"}, "box.json: line 2: name: has more than 3 letters (see the docs)"),
    ],
)
def test_a_fault_that_pydantic_finds_names_file_place_and_field(fields: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError) as caught:
        Box.model_validate(fields)
    assert str(input_error(caught.value, file="box.json", within="line 2", remedy="see the docs")) == said


def test_an_unknown_field_is_set_beside_the_known_ones() -> None:
    for name, remedy in (("widht", "did you mean 'width'?"), ("colour", "remove it")):
        with pytest.raises(ValidationError) as caught:
            Box.model_validate({name: 1})
        assert str(input_error(caught.value, known=Box.model_fields)) == f"{name}: unknown field ({remedy})"
    with pytest.raises(ValidationError) as caught:
        Box.model_validate([])
    assert str(input_error(caught.value)).startswith("input should be a valid dictionary")


def test_progress_sends_no_control_characters_to_a_terminal() -> None:
    stream = StringIO()
    with ConsoleProgress(stream) as progress:
        progress.start("pictures of \u202eevil\x1b[31m", 1)
        progress.message("a\tb\n\x1b]0;title\x07 [bold]c[/bold]")
    said = stream.getvalue()
    assert "b\n\\x1b]0;title\\x07 [bold]c[/bold]\n" in said
    assert "pictures of \\u202eevil\\x1b[31m: 0/1" in said


def test_a_long_stage_in_a_file_prints_its_remaining_time(monkeypatch: pytest.MonkeyPatch) -> None:
    now, stream = [0.0], StringIO()
    monkeypatch.setattr("gensim2.core.progress.time.monotonic", lambda: now[0])
    with ConsoleProgress(stream) as progress:
        progress.start("observations", 10)
        progress.advance(0)
        for seconds in (20.0, *[4.0] * 9):  # the first step includes the start of the workers
            now[0] += seconds
            progress.advance()
    assert stream.getvalue().splitlines() == [
        "observations: 4/10, about 0:00:24 left",
        "observations: 10/10 in 56.0 s",
    ]


def test_the_remaining_time_follows_a_new_total(monkeypatch: pytest.MonkeyPatch) -> None:
    now, stream = [0.0], StringIO()
    monkeypatch.setattr("gensim2.core.progress.time.monotonic", lambda: now[0])
    with ConsoleProgress(stream) as progress:
        progress.start("scenes", 2000)
        for seconds in (20.0, 20.0):
            now[0] += seconds
            progress.resize(150)
            progress.advance(50)
    assert stream.getvalue().splitlines() == ["scenes: 100/150, about 0:00:20 left", "scenes: 100/150 in 40.0 s"]

"""Whatever an error is made of, it reads as one line that a terminal can show."""

from __future__ import annotations

import pickle

from hypothesis import given
from hypothesis import strategies as st

from gensim2.errors import LONGEST_WORD, InputError, brief, one_line


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

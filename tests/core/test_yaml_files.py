"""The YAML reader: plain data is read, and anything else is refused in one line with file and line number."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from gensim2.core.errors import InputError
from gensim2.core.yaml_files import MAX_BYTES, MAX_DEPTH, parse_yaml, read_yaml

#: Nested aliases: ten lines that expand to three billion values.
LAUGHS = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{new}: &{new} [{','.join([f'*{old}'] * 9)}]\n" for old, new in zip("abcdefghi", "bcdefghij", strict=True)
)


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("a: 1\nd: 2020-13-45", 2, "type date is not allowed"),
        ("d: 2020-12-01", 1, "type date is not allowed"),
        ("a: 1\nb: 1\nc: " + "9" * 5000, 3, "more than 64 bits"),
        ("a: 0x" + "f" * 5000, 1, "more than 64 bits"),
        ("a: -" + "9" * 30, 1, "more than 64 bits"),
        ("a: !!int abc", 1, "'abc' is not a valid int"),
        ("a: !!float x", 1, "'x' is not a valid float"),
        ("a: !!bool perhaps", 1, "'perhaps' is not a valid bool"),
        ("a: !!map [1]", 1, "a list is not a mapping"),
        ("a: !!set {b}", 1, "type set is not allowed"),
        ("a: !!binary =", 1, "type binary is not allowed"),
        ("\na: !!python/object/apply:os.system [true]", 2, "is not allowed"),
        ("a: &a [*a]", 1, "*a refers to itself"),
        ("a: &a\n  b: *a", 2, "*a refers to itself"),
        (LAUGHS, 5, "more than 20000 values"),
        ("a: " + "[" * 50_000, 1, "nested more than"),
        ("- " * 40_000, 1, "nested more than"),
        ("a: " + "{b: " * 1000, 1, "nested more than"),
        ("a: 1\n<<: {b: 1}", 2, "type merge is not allowed"),
        ("? [a]\n: 1", 1, "the name of a field must be text"),
        ("a: {1: 2}", 1, "the name of a field must be text"),
        ("a: 1\nb: {c: 1, c: 2}", 2, "field 'c' is given twice"),
        ("a: 1\n---\nb: 1", 2, "another document"),
        ("a: 1\nb: \x00", 2, "a control character"),
        ("a: *b", 1, "undefined alias"),
        ('a: 1\nb: "\\ud800"', 2, "invalid Unicode character escape"),
        ("- a", 1, "must be a mapping from field names to values"),
        ("", 1, "must be a mapping from field names to values"),
    ],
)
def test_what_is_refused(text: str, line: int, words: str) -> None:
    started = time.process_time()
    with pytest.raises(InputError) as caught:
        parse_yaml(text.encode(), "task.yaml")
    message = str(caught.value)
    assert message.startswith(f"task.yaml: line {line}: ")
    assert words in message
    assert len(message) < 300
    assert time.process_time() - started < 2.0


@pytest.mark.parametrize("data", [b"a: '\xff'", "a: '\ud800'".encode("utf-8", "surrogatepass")])
def test_what_is_no_text(data: bytes) -> None:
    with pytest.raises(InputError, match=r"task\.yaml: is not UTF-8 text"):
        parse_yaml(data, "task.yaml")


def test_numbers_are_finite() -> None:
    with pytest.raises(InputError, match=r"task\.yaml: a\.b\.1: must be a finite number"):
        parse_yaml(b"a: {b: [1, .nan]}", "task.yaml")


def test_size_and_depth_end_where_they_say() -> None:
    text = "a: " + "x" * (MAX_BYTES - 3)
    assert parse_yaml(text.encode(), "f")["a"][:3] == "xxx"
    with pytest.raises(InputError, match="larger than 100 kB"):
        parse_yaml(text.encode() + b"x", "f")
    inside = MAX_DEPTH - 1
    parse_yaml(f"a: {'[' * (inside - 1)}1{']' * (inside - 1)}".encode(), "f")
    with pytest.raises(InputError, match="nested more than"):
        parse_yaml(f"a: {'[' * inside}1{']' * inside}".encode(), "f")


def test_honest_aliases_come_through() -> None:
    shared = [0.0, 0.0, 1.0]
    value = {"a": shared, "b": shared, "c": {"d": shared}}
    text = yaml.dump(value)
    assert "*id001" in text
    assert parse_yaml(text.encode(), "f") == value


def test_no_device_and_no_pipe_is_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (Path("/dev/zero"), tmp_path / "pipe"):
        with pytest.raises(InputError, match="is not a regular file"):
            read_yaml(path)
    with pytest.raises(InputError, match="cannot read: Is a directory"):
        read_yaml(tmp_path)
    with pytest.raises(InputError, match="cannot read: File name too long"):
        read_yaml(tmp_path / ("x" * 300))


PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(st.characters(codec="utf-8", exclude_categories=("Cc", "Cs")), max_size=20),
    lambda inner: st.lists(inner, max_size=4)
    | st.dictionaries(st.text("abc<=.", min_size=1, max_size=5), inner, max_size=4),
    max_leaves=12,
)  # fmt: skip


@given(st.dictionaries(st.text("abcdef", min_size=1, max_size=5), PLAIN, max_size=4))
@settings(max_examples=100, deadline=None)
def test_plain_data_survives_writing_and_reading(value: dict[str, object]) -> None:
    assert parse_yaml(yaml.safe_dump(value, allow_unicode=True).encode(), "f") == value


def test_truth_values_are_true_and_false_only(tmp_path: Path) -> None:
    path = tmp_path / "words.yaml"
    path.write_text("on: off\nyes: [no, y, N, On]\ntrue_ones: [true, True, false]\n")
    assert read_yaml(path) == {"on": "off", "yes": ["no", "y", "N", "On"], "true_ones": [True, True, False]}

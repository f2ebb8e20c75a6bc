"""Damage files at random by a seed, like a user, a failing disk or another program.

``damaged(data, kind, generator)`` returns a damaged copy of a good file; the same generator state gives the same bytes.
``judged(read)`` runs a reader and returns how it ended.
"""

from __future__ import annotations

import copy
import json
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from types import FrameType
from typing import Any, Literal

import numpy as np
import yaml

from gensim2.core.errors import InputError

Kind = Literal["json", "yaml", "lines", "binary"]

#: Values for replacing the value of a field.
HOSTILE_VALUES: tuple[Any, ...] = (
    None,
    True,
    0,
    -1,
    2**31,
    2**63,
    2**64,
    -(10**40),
    10**400,
    0.5,
    -0.0,
    1e-320,
    1e308,
    float("nan"),
    float("inf"),
    float("-inf"),
    "",
    " ",
    "0",
    "nan",
    "../../x",
    "/dev/zero",
    "/dev/null",
    "a\0b",
    "\u202e\x1b[31m",
    "\ud800",
    "x" * 100_000,
    [],
    [[]],
    [None],
    [1, 2, 3],
    [0.0] * 1000,
    {},
    {"": {}},
    {"type": []},
)

#: Words for replacing words in text files, by their type in YAML, JSON and numbers.
HOSTILE_WORDS: tuple[str, ...] = (
    "2020-13-45",
    "2020-01-01",
    "2020-01-01T99:99:99",
    "9" * 5000,
    "-" + "9" * 400,
    "0x" + "f" * 400,
    "0b" + "1" * 400,
    "1_0:99:99",
    "1e999",
    "-1e-999",
    ".nan",
    "-.inf",
    "NaN",
    "Infinity",
    "!!int abc",
    "!!float x",
    "!!timestamp x",
    "!!binary =",
    "!!set {a, b}",
    "!!omap [a: 1]",
    "!!python/object/apply:os.system [true]",
    "!!bool perhaps",
    "!!null x",
    "&a [*a]",
    "*a",
    "<<: *a",
    "<<: 1",
    "? [a]",
    "? {a: 1}",
    "[" * 2000,
    "{a: " * 500,
    "- " * 2000,
    "\t",
    "\x00",
    "\ufeff",
    "---",
    "...",
    "%YAML 9.9",
    "|",
    ">",
    "null",
    "~",
    "yes",
    '"',
    "'",
    "\\",
    "}",
    "]",
    ":",
    ",",
    "#",
)


def damaged(data: bytes, kind: Kind, generator: np.random.Generator) -> bytes:
    """Apply one to three damages that fit the file.

    Args:
        data: a good file.
        kind: ``"json"`` and ``"yaml"`` are also damaged as values and as text, ``"lines"`` (of JSON) as text.
        generator: source of all random choices.
    """
    for _ in range(int(generator.integers(1, 4))):
        ways: list[Callable[[bytes, np.random.Generator], bytes]] = [_bytes]
        if kind != "binary":
            ways += [_text, _text]
        if kind in ("json", "yaml"):
            ways += [_value_of(kind)] * 4
        if kind == "lines":
            ways += [_one_line] * 4
        data = ways[int(generator.integers(len(ways)))](data, generator)
    return data


def damaged_value(value: Any, generator: np.random.Generator) -> Any:
    """Return plain data with one entry deleted, repeated, renamed, moved, nested or replaced."""
    value = copy.deepcopy(value)
    places = list(_places(value))
    if not places:
        return _pick(HOSTILE_VALUES, generator)
    parent, key = places[int(generator.integers(len(places)))]
    way = int(generator.integers(8))
    if way == 0:
        del parent[key]
    elif way == 1 and isinstance(parent, list):
        parent.insert(int(generator.integers(len(parent) + 1)), copy.deepcopy(parent[key]))
    elif way == 1:
        parent[_pick(("", "Name", f"{key}_", "schema_version", "x" * 300), generator)] = parent.pop(key)
    elif way == 2:
        other, other_key = places[int(generator.integers(len(places)))]
        parent[key] = copy.deepcopy(other[other_key])
    elif way == 3:
        for _ in range(int(generator.integers(1, 60))):
            parent[key] = [parent[key]] if generator.random() < 0.5 else {"a": parent[key]}
    elif way == 4 and isinstance(parent[key], int | float) and not isinstance(parent[key], bool):
        factor = float(generator.choice([-1.0, 0.0, 1e-9, 1e3, 1e9, 1e300]))
        # A whole number from earlier damage may be too large for a float.
        parent[key] = parent[key] * factor if abs(parent[key]) < 2**1000 else -parent[key]
    elif way == 5 and isinstance(parent[key], str):
        parent[key] = parent[key][: int(generator.integers(len(parent[key]) + 1))]
    else:
        parent[key] = copy.deepcopy(_pick(HOSTILE_VALUES, generator))
    return value


@dataclass(frozen=True)
class Verdict:
    """How a reader ended.

    Attributes:
        accepted: whether it returned; otherwise it raised an :class:`InputError`.
        message: the error message.
        seconds: its CPU time.
    """

    accepted: bool
    message: str
    seconds: float

    @property
    def outcome(self) -> str:
        return "accepted" if self.accepted else "refused"


#: CPU limit (s) of a reader or a command, which does not depend on other load of the machine.
LIMIT = 5.0

#: Total time limit (s) for readers that wait without using the CPU.
PATIENCE = 60.0

#: Characters of the longest error message that is still useful.
LONGEST_MESSAGE = 2000


class _TooSlowError(BaseException):
    """Is not caught by ``except Exception`` in a reader that hangs."""


def judged(read: Callable[[], object], limit: float = LIMIT) -> Verdict:
    """Run a reader, which must return or refuse in one line.

    Raises:
        AssertionError: it used more than ``limit`` seconds of CPU, hung, or refused in more than one line or a long
            one.
        Exception: any other exception that it raised, which is a bug.
    """

    def alarm(_: int, __: FrameType | None) -> None:
        raise _TooSlowError

    before = {number: signal.signal(number, alarm) for number in (signal.SIGALRM, signal.SIGPROF)}
    started = time.process_time()
    signal.setitimer(signal.ITIMER_PROF, limit)
    signal.setitimer(signal.ITIMER_REAL, max(PATIENCE, 2 * limit))
    try:
        read()
        accepted, message = True, ""
    except InputError as error:
        accepted, message = False, str(error)
    except _TooSlowError:
        raise AssertionError(f"took longer than {limit} s") from None
    finally:
        for timer in (signal.ITIMER_PROF, signal.ITIMER_REAL):
            signal.setitimer(timer, 0)
        for number, handler in before.items():
            signal.signal(number, handler)
    if not accepted:
        check_line(message)
    return Verdict(accepted, message, time.process_time() - started)


def check_line(text: str) -> None:
    """Check that a message is one printable line of bounded length."""
    assert text.strip(), "refused without a word"
    assert len(text.splitlines()) == 1, f"more than one line: {text!r}"
    assert len(text) <= LONGEST_MESSAGE, f"{len(text)} characters: {text[:200]!r}..."
    assert text.isprintable(), repr(text)


def _pick(values: Any, generator: np.random.Generator) -> Any:
    return values[int(generator.integers(len(values)))]


def _places(value: Any) -> list[tuple[Any, Any]]:
    """Return (container, key) of everything inside ``value``."""
    found: list[tuple[Any, Any]] = []
    if isinstance(value, dict):
        for key, item in value.items():
            found += [(value, key), *_places(item)]
    elif isinstance(value, list):
        for index, item in enumerate(value):
            found += [(value, index), *_places(item)]
    return found


def _span(length: int, generator: np.random.Generator) -> tuple[int, int]:
    start = int(generator.integers(length + 1))
    return start, min(length, start + int(generator.integers(1, max(2, min(length, 4096)))))


def _bytes(data: bytes, generator: np.random.Generator) -> bytes:
    start, end = _span(len(data), generator)
    junk = generator.bytes(end - start)
    ways = (
        lambda: data[:start],
        lambda: b"",
        lambda: data[:start] + data[end:],
        lambda: data[:end] + data[start:],
        lambda: data[:start] + bytes(end - start) + data[end:],
        lambda: data[:start] + junk + data[end:],
        lambda: _flipped(data, generator),
        lambda: _flipped(data, generator),
        lambda: data + data,
    )
    return bytes(ways[int(generator.integers(len(ways)))]())


def _flipped(data: bytes, generator: np.random.Generator) -> bytes:
    if not data:
        return generator.bytes(1)
    changed = bytearray(data)
    for _ in range(int(generator.integers(1, 9))):
        changed[int(generator.integers(len(changed)))] ^= 1 << int(generator.integers(8))
    return bytes(changed)


def _text(data: bytes, generator: np.random.Generator) -> bytes:
    """Replace, repeat, delete or indent a word or a line."""
    lines = data.split(b"\n")
    index = int(generator.integers(len(lines)))
    line = lines[index]
    word = _pick(HOSTILE_WORDS, generator).encode("utf-8", "surrogatepass")
    way = int(generator.integers(6))
    if way == 0:
        del lines[index]
    elif way == 1:
        lines.insert(int(generator.integers(len(lines))), line)
    elif way == 2:
        lines[index] = b" " * int(generator.integers(1, 9)) + line
    elif way == 3:
        lines.insert(index, word)
    else:
        words = line.split(b" ")
        words[int(generator.integers(len(words)))] = word
        lines[index] = b" ".join(words)
    return b"\n".join(lines)


def _value_of(kind: Kind) -> Callable[[bytes, np.random.Generator], bytes]:
    def change(data: bytes, generator: np.random.Generator) -> bytes:
        try:
            value = json.loads(data) if kind == "json" else yaml.safe_load(data)
            value = damaged_value(value, generator)
            return _json(value) if kind == "json" else _yaml(value)
        except (ValueError, TypeError, LookupError, AttributeError, RecursionError, yaml.YAMLError):
            return _text(data, generator)  # already damaged, not parsable

    return change


def _one_line(data: bytes, generator: np.random.Generator) -> bytes:
    lines = data.split(b"\n")
    index = int(generator.integers(len(lines)))
    try:
        lines[index] = _json(damaged_value(json.loads(lines[index]), generator))
    except (ValueError, RecursionError):  # already damaged, or the empty last line
        return _text(data, generator)
    return b"\n".join(lines)


def _json(value: Any) -> bytes:
    return json.dumps(value, indent=None).encode("utf-8", "surrogatepass")


def _yaml(value: Any) -> bytes:
    text: str = yaml.safe_dump(value, sort_keys=False, allow_unicode=True)
    return text.encode("utf-8", "surrogatepass")

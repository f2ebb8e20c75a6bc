"""Jobs for the tests of this folder, which workers import by name."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

from gensim2.core.errors import InputError


def square(value: int, delay: float = 0.0) -> int:
    time.sleep(delay)
    return value * value


def process_id(_: int, delay: float = 0.0) -> int:
    time.sleep(delay)
    return os.getpid()


def spin(seconds: float) -> float:
    """Use the given seconds of CPU time."""
    begin = time.process_time()
    while time.process_time() - begin < seconds:
        pass
    return seconds


PREPARED: list[int] = []


def prepare_at_length(value: int) -> None:
    spin(0.5)
    PREPARED.append(value)


def prepared(_: int) -> list[int]:
    return PREPARED


def fail(value: int) -> int:
    raise InputError("is odd", file="numbers.txt", field=str(value), remedy="give an even one")


def die(value: int) -> int:
    os._exit(7)


def hang(value: int) -> int:
    time.sleep(3600)
    return value


class LocalError(Exception):
    """An error that cannot be pickled, because its constructor needs two arguments."""

    def __init__(self, a: int, b: int) -> None:
        super().__init__(f"{a} and {b}")


def fail_oddly(value: int) -> int:
    raise LocalError(value, value + 1)


def fail_by_a_bug(value: int) -> int:
    return value // 0


def panic(value: int) -> int:
    raise BaseException("not even an Exception")


def evaluated(config: Any, spec: Any, seed: int, stop: str, keep: Any, index: int) -> Any:
    """Replace an episode of ``gensim2 evaluate`` by one of the fake world."""
    import fake_world

    return fake_world.episode(config, {}, seed)


def die_at_first(value: int, tries: str, needed: int) -> tuple[int, int]:
    """Kill this process until it was tried ``needed`` times; then return ``value`` and the number of tries."""
    path = Path(tries)
    with path.open("a") as stream:
        stream.write(f"{os.getpid()}\n")
    count = len(path.read_text().split())
    if count < needed:
        os.kill(os.getpid(), signal.SIGKILL)
    return value, count

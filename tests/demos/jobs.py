"""Jobs for the pool's tests: plain functions that a worker can import."""

from __future__ import annotations

import os
import time

from gensim2.errors import InputError


def square(value: int, delay: float = 0.0) -> int:
    time.sleep(delay)
    return value * value


def process_id(_: int) -> int:
    return os.getpid()


def fail(value: int) -> int:
    raise InputError("is odd", file="numbers.txt", field=str(value), remedy="give an even one")


def die(value: int) -> int:
    os._exit(7)


def hang(value: int) -> int:
    time.sleep(3600)
    return value


class LocalError(Exception):
    """Does not survive pickling: its constructor wants two arguments."""

    def __init__(self, a: int, b: int) -> None:
        super().__init__(f"{a} and {b}")


def fail_oddly(value: int) -> int:
    raise LocalError(value, value + 1)

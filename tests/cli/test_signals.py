"""Ctrl-C ends a command at any moment."""

from __future__ import annotations

import os
import signal
import time

import pytest

from gensim2.cli.main import stopping_signals
from gensim2.core.errors import Stopped

#: A function that catches all exceptions, as trimesh does around its imports.
SWALLOWS = """
def work(number):
    try:
        os.kill(os.getpid(), number)
        time.sleep(0.15)
        return "done"
    except BaseException:
        return "swallowed"
"""


def _function_of(package: str) -> dict[str, object]:
    held: dict[str, object] = {"__name__": f"{package}.graph", "os": os, "time": time}
    exec(SWALLOWS, held)
    return held


@pytest.mark.fast
@pytest.mark.parametrize(("number", "error"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, Stopped)])
def test_what_comes_inside_a_package_that_catches_everything_is_raised_behind_it(
    number: int, error: type[BaseException]
) -> None:
    before = [signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)]
    work = _function_of("trimesh")["work"]
    assert callable(work)
    found = []

    def command() -> None:
        with stopping_signals():
            found.append(work(number))
            time.sleep(5)

    with pytest.raises(error):
        command()
    assert found == ["done"]
    assert [signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)] == before
    time.sleep(0.1)  # no timer may be left that would fire now


@pytest.mark.fast
def test_elsewhere_it_is_raised_at_once() -> None:
    work = _function_of("another")["work"]
    assert callable(work)
    with stopping_signals():
        assert work(signal.SIGINT) == "swallowed"

"""What all tests share."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from gensim2.objects import Library, open_library

# A first example imports libraries, and machines are shared: clocks are no test.
settings.register_profile("gensim2", deadline=None)
settings.load_profile("gensim2")

# Tasks that whoever runs the tests keeps are none of theirs; set here, as names are collected before any fixture runs.
os.environ["GENSIM2_LIBRARY"] = "none"

# A background job of a shell ignores Ctrl-C, and so would the commands that tests interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave out tests on real objects where there are none: a clone has none, they may not be passed on."""
    if os.environ.get("GENSIM2_ASSETS"):
        return
    skip = pytest.mark.skip(reason="needs real objects: set GENSIM2_ASSETS to their folder")
    for item in items:
        if item.get_closest_marker("real") is not None:
            item.add_marker(skip)


@pytest.fixture
def real_assets() -> Path:
    """Folder of the real objects."""
    return Path(os.environ["GENSIM2_ASSETS"])


@pytest.fixture(scope="session", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A cache of the tests' own, so that nothing prepared before hides what is tested; ``GENSIM2_CACHE`` where set."""
    with pytest.MonkeyPatch.context() as patch:
        if not os.environ.get("GENSIM2_CACHE"):
            patch.setenv("GENSIM2_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="session")
def library(cache: None) -> Library:
    """The generated library."""
    return open_library("builtin")

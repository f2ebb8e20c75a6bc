"""What all tests share."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

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

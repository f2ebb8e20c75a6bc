"""What all tests share."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Generator, Iterator
from multiprocessing import forkserver
from pathlib import Path

# Tests share the cores already: what is imported below looks for these when it starts threads of its own.
os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")

# Half of an import is compiling, and hundreds of processes import the same: where Python is told to leave nothing
# beside the sources (containers often say so), what it compiles is kept here.
if sys.dont_write_bytecode:
    sys.dont_write_bytecode, sys.pycache_prefix = False, str(Path(__file__).parents[1] / ".pytest_cache" / "bytecode")
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix

import pytest
import suite
import warm
from hypothesis import settings

from gensim2.objects import Library, open_library

# A first example imports libraries, and machines are shared: clocks are no test.
settings.register_profile("gensim2", deadline=None)
settings.load_profile("gensim2")

# Tasks that whoever runs the tests keeps are none of theirs; set here, as names are collected before any fixture runs.
os.environ["GENSIM2_LIBRARY"] = "none"

# A background job of a shell ignores Ctrl-C, and so would the commands that tests interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave files without quick tests unimported if only quick tests are selected."""
    if config.option.markexpr != "fast" or not collection_path.name.startswith("test_"):
        return None
    return suite.place(collection_path) not in (*suite.FAST, *suite.PARTLY_FAST) or None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what is quick, put first what takes longest, and leave out tests on real objects where there are none.

    A clone has none, they may not be passed on.
    """
    ranks = {name: rank for rank, name in enumerate(suite.LONGEST)}
    items.sort(key=lambda item: ranks.get(suite.place(item.path), len(ranks)))  # stable: a file stays in its order
    for item in items:
        if suite.place(item.path) in suite.FAST:
            item.add_marker(pytest.mark.fast)
    if os.environ.get("GENSIM2_ASSETS"):
        return
    skip = pytest.mark.skip(reason="needs real objects: set GENSIM2_ASSETS to their folder")
    for item in items:
        if item.get_closest_marker("real") is not None:
            item.add_marker(skip)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Fail a test that is skipped in continuous integration and not listed."""
    return suite.fail_unlisted_skip((yield))


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Fail a module that skips itself in continuous integration and is not listed."""
    return suite.fail_unlisted_skip((yield))


@pytest.fixture(scope="session")
def real_assets() -> Path:
    """Folder of the real objects."""
    return Path(os.environ["GENSIM2_ASSETS"])


@pytest.fixture(scope="session", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A cache of this run's own, so that nothing prepared before hides what is tested; ``GENSIM2_CACHE`` where set.

    All processes of a run share it: what one has prepared none prepares again.
    """
    with pytest.MonkeyPatch.context() as patch:
        if not os.environ.get("GENSIM2_CACHE"):
            place = tmp_path_factory.getbasetemp()
            shared = place.parent if os.environ.get("PYTEST_XDIST_WORKER") else place
            (shared / "cache").mkdir(exist_ok=True)
            patch.setenv("GENSIM2_CACHE", str(shared / "cache"))
        yield


@pytest.fixture(scope="session", autouse=True)
def warm_server() -> Iterator[None]:
    """One server of processes with everything imported: what the first pool asks for holds for all after it."""
    with pytest.MonkeyPatch.context() as patch:
        forkserver.set_forkserver_preload(list(warm.MODULES))
        patch.setattr(forkserver, "set_forkserver_preload", lambda names: None)
        yield


@pytest.fixture(scope="session")
def library(cache: None) -> Library:
    """The generated library."""
    return open_library("builtin")

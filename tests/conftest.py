"""Settings and fixtures of all tests."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Generator, Iterator
from multiprocessing import forkserver
from pathlib import Path

# Tests run in parallel, so libraries may start only one thread each; this must be set before they are imported.
os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")

# Hundreds of processes import the same modules, and half of the time is compilation. Where Python must not write byte
# code beside the sources (common in containers), it goes to a folder of its own.
if sys.dont_write_bytecode:
    sys.dont_write_bytecode, sys.pycache_prefix = False, str(Path(__file__).parents[1] / ".pytest_cache" / "bytecode")
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix

import pytest
import suite
import warm
from hypothesis import settings

from gensim2.objects import Library, open_library

# The first example of a property test imports libraries, so its time limit is off. The examples
# are the same in each run.
settings.register_profile("gensim2", deadline=None, derandomize=True)
settings.load_profile("gensim2")

# Hide the user's own tasks; set here because names are read during collection, before fixtures.
os.environ["GENSIM2_LIBRARY"] = "none"

# Background jobs of a shell ignore Ctrl-C, and so would the commands that tests interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Do not import files without fast tests if only fast tests are selected."""
    if config.option.markexpr != "fast" or not collection_path.name.startswith("test_"):
        return None
    return suite.place(collection_path) not in (*suite.FAST, *suite.PARTLY_FAST) or None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark fast tests, put the slowest first, and leave out tests on real objects if these are missing.

    A clone does not contain the real objects, because they may not be redistributed.
    """
    ranks = {name: rank for rank, name in enumerate(suite.LONGEST)}
    items.sort(key=lambda item: ranks.get(suite.place(item.path), len(ranks)))  # stable: keeps the order within a file
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
    """Fail a test that is skipped in continuous integration without being listed."""
    return suite.fail_unlisted_skip((yield))


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Fail a module that is skipped in continuous integration without being listed."""
    return suite.fail_unlisted_skip((yield))


@pytest.fixture(scope="session")
def real_assets() -> Path:
    """Folder of the real objects."""
    return Path(os.environ["GENSIM2_ASSETS"])


@pytest.fixture(scope="session", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A new cache for this run, shared by its processes, or ``GENSIM2_CACHE`` if set."""
    with pytest.MonkeyPatch.context() as patch:
        if not os.environ.get("GENSIM2_CACHE"):
            place = tmp_path_factory.getbasetemp()
            shared = place.parent if os.environ.get("PYTEST_XDIST_WORKER") else place
            (shared / "cache").mkdir(exist_ok=True)
            patch.setenv("GENSIM2_CACHE", str(shared / "cache"))
        yield


@pytest.fixture(scope="session", autouse=True)
def warm_server() -> Iterator[None]:
    """Start the fork server with everything imported, because the first pool decides for all later ones."""
    with pytest.MonkeyPatch.context() as patch:
        forkserver.set_forkserver_preload(list(warm.MODULES))
        patch.setattr(forkserver, "set_forkserver_preload", lambda names: None)
        yield


@pytest.fixture(scope="session")
def library(cache: None) -> Library:
    """The generated library."""
    return open_library("builtin")

"""Collections in a fake world, in this process and in workers."""

from __future__ import annotations

import contextlib
import resource
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

sys.path[:0] = [str(Path(__file__).parents[1] / name) for name in ("kill", "design/runs")]

import fake_world  # noqa: E402
import kill_runs  # noqa: E402

from gensim2.data import collect  # noqa: E402
from gensim2.data.collection import CollectionResult  # noqa: E402
from gensim2.rollout import worker  # noqa: E402

TASKS = ("OpenDrawer", "CloseBox")


def _install(patch: pytest.MonkeyPatch) -> None:
    for name in fake_world.REPLACED:
        patch.setattr(worker, name, getattr(worker, name))
    fake_world.install()
    patch.setattr(fake_world, "EPISODE_SECONDS", 0.0)


@pytest.fixture(autouse=True)
def made_up_world(monkeypatch: pytest.MonkeyPatch) -> None:
    """Use the fake world, so that no test of data sets waits for physics."""
    _install(monkeypatch)


@contextlib.contextmanager
def _small_disk(size: int = 4096) -> Iterator[None]:
    before, keeps_none = resource.getrlimit(resource.RLIMIT_FSIZE), sys.dont_write_bytecode
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    sys.dont_write_bytecode = True  # Python does not notice truncated byte code
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        sys.dont_write_bytecode = keeps_none


@pytest.fixture
def small_disk() -> Callable[..., contextlib.AbstractContextManager[None]]:
    """Return a function that makes a context in which files of this process cannot exceed a size, as on a full disk."""
    return _small_disk


@pytest.fixture
def gather(tmp_path: Path) -> Callable[..., CollectionResult]:
    """Return a function that collects eight episodes of two tasks into ``tmp_path / "set"``."""

    def call(*tasks: str, **options: Any) -> CollectionResult:
        given: dict[str, Any] = {"episodes": 8, "seed": 3, "workers": 0, "assets": "builtin", **options}
        return collect(tasks or TASKS, out=given.pop("out", tmp_path / "set"), **given)

    return call


@pytest.fixture(scope="session")
def gathered(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Return ``gathered(to, episodes)``, which copies the result of ``gather(episodes=N)``, made once."""
    made: dict[int, Path] = {}

    def call(to: Path, episodes: int = 8) -> Path:
        if episodes not in made:
            made[episodes] = tmp_path_factory.mktemp("gathered") / "set"
            with pytest.MonkeyPatch.context() as patch:
                _install(patch)
                collect(TASKS, episodes=episodes, seed=3, workers=0, assets="builtin", out=made[episodes])
        return shutil.copytree(made[episodes], to)

    return call


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The same episodes from an uninterrupted run."""
    out = tmp_path_factory.mktemp("undisturbed") / "set"
    with pytest.MonkeyPatch.context() as patch:
        _install(patch)
        collect(TASKS, episodes=8, seed=3, workers=0, assets="builtin", out=out)
    return kill_runs.contents(out)

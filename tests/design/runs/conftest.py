"""Runs in a fake world, in this process and in workers."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

sys.path[:0] = [str(Path(__file__).parent), *(str(Path(__file__).parents[2] / name) for name in ("kill", "processes"))]

import fake_world  # noqa: E402
import kill_runs  # noqa: E402

from gensim2.design import demo  # noqa: E402
from gensim2.design.single import DemoResult  # noqa: E402
from gensim2.rollout import worker  # noqa: E402

Contents = dict[str, Any]


@pytest.fixture(autouse=True)
def made_up_world(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Use the fake world, except in modules with ``SIMULATOR = True``."""
    if not getattr(request.module, "SIMULATOR", False):
        _install(monkeypatch)


def _install(patch: pytest.MonkeyPatch) -> None:
    for name in fake_world.REPLACED:
        patch.setattr(worker, name, getattr(worker, name))
    fake_world.install()
    patch.setattr(fake_world, "EPISODE_SECONDS", 0.0)


@pytest.fixture
def record(tmp_path: Path) -> Callable[..., DemoResult]:
    """Return a function that records six demonstrations in ``tmp_path / "run"``."""

    def call(out: Path = tmp_path / "run", **options: Any) -> DemoResult:
        given: dict[str, Any] = {"episodes": 6, "seed": 3, "workers": 0, "assets": "builtin", "videos": 0, **options}
        return demo(given.pop("task", "OpenDrawer"), out=out, **given)

    return call


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Contents:
    """The six demonstrations of an uninterrupted run."""
    out = tmp_path_factory.mktemp("undisturbed") / "run"
    with pytest.MonkeyPatch.context() as patch:
        _install(patch)
        demo("OpenDrawer", episodes=6, seed=3, workers=0, assets="builtin", videos=0, out=out)
    return kill_runs.contents(out)

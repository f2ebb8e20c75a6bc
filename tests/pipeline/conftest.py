"""Runs in a made-up world, in this process and in workers."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "kill")]

import fake_world
import kill_runs

from gensim2.pipeline import demo, worker
from gensim2.pipeline.single import DemoResult

Contents = dict[str, Any]


@pytest.fixture(autouse=True)
def made_up_world(monkeypatch: pytest.MonkeyPatch) -> None:
    """No test of runs waits for physics; ``tests/pipeline/test_worker.py`` has its own."""
    for name in ("PRELOAD", "screen_scene", "attempt", "demonstrate"):
        monkeypatch.setattr(worker, name, getattr(worker, name))
    fake_world.install()
    monkeypatch.setattr(fake_world, "EPISODE_SECONDS", 0.0)


@pytest.fixture
def record(tmp_path: Path) -> Callable[..., DemoResult]:
    """Records six demonstrations in ``tmp_path / "run"``."""

    def call(out: Path = tmp_path / "run", **options: Any) -> DemoResult:
        given: dict[str, Any] = {"episodes": 6, "seed": 3, "workers": 0, "assets": "builtin", "video": False, **options}
        return demo(given.pop("task", "OpenDrawer"), out=out, **given)

    return call


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Contents:
    """What those six leave where nothing happens."""
    out = tmp_path_factory.mktemp("undisturbed") / "run"
    with pytest.MonkeyPatch.context() as patch:
        made_up_world.__wrapped__(patch)  # type: ignore[attr-defined]
        demo("OpenDrawer", episodes=6, seed=3, workers=0, assets="builtin", video=False, out=out)
    return kill_runs.contents(out)

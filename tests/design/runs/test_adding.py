"""A user's task is verified and added, or refused with the reason, with fake episodes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import fake_world
import pytest

from gensim2.cli.main import run
from gensim2.objects import open_library
from gensim2.rollout import worker
from gensim2.rollout.checker_result import Mutation, WorldCount
from gensim2.tasks.library import load_strategies, load_task
from gensim2.core.yaml_files import dump_yaml


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A task of the package with another name and goal, as a user would write it."""
    task = load_task("OpenBox").model_dump(mode="json", exclude_none=True, by_alias=True)
    made = tmp_path / "mine"
    (made / "strategies").mkdir(parents=True)
    step = {**task["steps"][0], "done": [{"type": "articulated_between", "object": "box", "low": 0.55, "high": 0.75}]}
    if "box" not in task["objects"]:
        step["done"][0]["object"] = next(iter(task["objects"]))
    task |= {"name": "OpenMyBoxABit", "description": "open my box a bit", "steps": [step]}
    task.pop("provenance", None)
    task.pop("goal", None)
    (made / "task.yaml").write_text(dump_yaml(task))
    for name, data in load_strategies("OpenBox").items():
        (made / "strategies" / f"{name}.yaml").write_text(dump_yaml(dict(data)))
    return made


def made_up(monkeypatch: pytest.MonkeyPatch, held: int) -> None:
    """Let the first ``held`` of each 20 episodes succeed."""
    count = iter(range(10_000))

    def episode(config: Any, strategies: Any, seed: int) -> Any:
        thing = next(iter(config.task.objects.values()))
        model = open_library("builtin").load(thing.asset_class, "0")
        return fake_world.episode_of(config.task, seed, held=next(count) % 20 < held, content_hash=model.content_hash)

    monkeypatch.setattr(worker, "prepare", lambda scene: None)
    monkeypatch.setattr(worker, "episode", episode)


@pytest.mark.parametrize(("held", "code"), [(20, 0), (11, 2)])
def test_it_is_verified_and_added_or_refused(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], held: int, code: int
) -> None:
    from functools import partial

    import gensim2.design.remembering as adding

    made_up(monkeypatch, held)
    monkeypatch.setattr(adding, "add_task", partial(_here, adding.add_task))
    words = ["tasks", "add", str(folder), "--assets", "builtin", "--library", str(tmp_path / "library")]
    assert run(words) == code
    out, err = capsys.readouterr()
    added = tmp_path / "library" / "OpenMyBoxABit"
    if code == 0:
        assert "OpenMyBoxABit" in out
        told = (added / "task.yaml").read_text()
        assert "origin: hand" in told
        assert "held: 20" in told
        assert json.loads((added / "added.json").read_text())
        assert run(words) == 0, "the very same again changes nothing"
    else:
        assert "11 of 20 fresh episodes succeeded" in err
        assert not added.exists()


def test_a_task_whose_criteria_lie_is_not_added(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from functools import partial

    import gensim2.design.remembering as adding

    made_up(monkeypatch, 20)
    monkeypatch.setattr(adding, "add_task", partial(_here, adding.add_task))
    lie = [WorldCount(None, str(Mutation.AT_START), "box", ("articulated_between",), 4, 1)]
    monkeypatch.setattr(worker, "judge_scene", lambda config, seed: lie)
    monkeypatch.setattr(worker, "episode", None)
    assert run(["tasks", "add", str(folder), "--assets", "builtin", "--library", str(tmp_path / "library")]) == 2
    said = capsys.readouterr().err
    assert "hold in 10 of 40 worlds in which the task is not done" in said
    assert "box: it was left where it was" in said
    assert not (tmp_path / "library" / "OpenMyBoxABit").exists()


def _here(add: Any, folder: Path, **given: Any) -> Any:
    return add(folder, **{**given, "workers": 0})

"""The output of ``gensim2 tasks show``."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from conditions import PLAIN

from gensim2.cli.main import run
from gensim2.data.runfolder import TaskFolder
from gensim2.design import description
from gensim2.tasks.figures import Condition, Figure
from gensim2.tasks.library import load_strategies, load_task

LONG = "PlaceGolfBallIntoDrawer"


def figure(physics: str = "ours") -> Figure:
    """Return a row as a benchmark writes it."""
    condition = Condition.model_validate({"objects": "real", **PLAIN, "physics": physics})
    return Figure(
        task=LONG,
        condition=condition,
        seed=1,
        runs=5,
        episodes=250,
        paper=240,
        held=230,
        strict=200,
        deviation=0.02,
        partial=3,
        causes={"grasp missed": 20},
        strict_misses={"not held": 20},
        objects={"drawer": 40},
    )


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the published figures of a task by rows of two conditions."""
    rows = (figure(), figure("original"))
    monkeypatch.setattr(description, "figures_of", lambda name: rows if name == LONG else ())


def test_it_tells_objects_steps_strategies_goal_and_figures(measured: None, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["tasks", "show", LONG]) == 0
    text = capsys.readouterr().out
    task = load_task(LONG)
    assert task.description in text
    assert "goal: drawer and ball within 5 cm, seen from above and openness of the drawer below 0.2" in text
    assert "on the table at (-0.2, -0.45) m" in text
    assert "openness 0.5 ± 0.15" in text
    assert task.provenance is not None
    for step in task.steps:
        for name in step.strategies:
            made = task.provenance.strategies[name]
            assert re.search(rf"\b{name}: .*\(by {made.by}, seen: {made.seen}\)", text)
    assert "0.56 ± 0.09" in text  # the paper's figure
    for condition in ("default physics, real objects", "the original's physics, real objects"):
        assert re.search(rf"{condition} +250 +0\.96 +0\.92 \(0\.88 to 0\.95\) +0\.80", text)


def test_json_holds_the_same(measured: None, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["tasks", "show", LONG, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [step["name"] for step in told["steps"]] == ["open", "grasp", "place", "close"]
    assert [step["tool"] for step in told["steps"]] == [None, None, "ball", None]
    assert told["steps"][1]["strategies"][0]["kind"] == "grasp"
    opened = {"type": "articulated_open", "object": "drawer", "threshold": 0.8}
    assert (told["steps"][0]["done"], told["steps"][0]["done_criteria"]) == (
        "openness of the drawer above 0.8",
        [opened],
    )
    assert {each["type"] for each in told["goal_criteria"]} >= {"articulated_closed"}
    assert told["figures"]["paper"] == {"mean": 0.56, "deviation": 0.09}
    assert told["figures"]["original"] is None
    (ours, original) = told["figures"]["measured"]
    assert ours["rates"]["held"]["mean"] == 0.92
    assert original["condition"]["physics"] == "original"
    assert run(["tasks", "show", "OpenBox", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["figures"]["original"] == {"successes": 8, "episodes": 10}


def test_figures_are_those_of_the_librarys_strategies(
    measured: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    strategies = load_strategies(LONG)
    for name, changes, rows in (("same", {}, 2), ("other", {"contact_speed": 0.123}, 0)):
        files = TaskFolder(tmp_path / name)
        files.write_task(load_task(LONG))
        first, *_ = strategies
        files.write_strategies({**strategies, first: {**strategies[first], **changes}})
        assert run(["tasks", "show", str(files.path), "--json"]) == 0
        assert len(json.loads(capsys.readouterr().out)["figures"]["measured"]) == rows


def test_a_task_of_ones_own_under_a_known_name_has_not_the_papers_figures(
    measured: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, seconds, has_figures in (("same", 0, True), ("other", 1, False)):
        task, files = load_task("OpenBox"), TaskFolder(tmp_path / name)
        files.write_task(task.model_copy(update={"max_episode_steps": task.max_episode_steps + 20 * seconds}))
        files.write_strategies(load_strategies("OpenBox"))
        assert run(["tasks", "show", str(files.path), "--json"]) == 0
        figures = json.loads(capsys.readouterr().out)["figures"]
        assert [figures[each] is not None for each in ("paper", "original")] == [has_figures] * 2


def test_an_unknown_task_is_bad_input(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["tasks", "show", "OpenDrawr"]) == 2
    assert "did you mean OpenDrawer" in capsys.readouterr().err

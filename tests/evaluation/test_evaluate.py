"""``gensim2 evaluate``: any controller on the benchmark's scenes, with the benchmark's table."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import imageio.v2 as imageio
import numpy as np
import pytest

import gensim2
from gensim2.cli import evaluate as command
from gensim2.cli.main import run
from gensim2.core.errors import InputError
from gensim2.data.films import DOT, PAPER, SIZE
from gensim2.rollout.config import DEFAULT_ROLLOUT
from gensim2.rollout.controller_spec import ControllerError, ControllerSpec, planner_spec
from gensim2.rollout.record import Cause
from gensim2.tasks.library import load_strategies, load_task

CONTROLLERS = Path(__file__).parents[1] / "rollout" / "controllers.py"


def test_a_controller_of_ones_own_is_measured_and_its_errors_are_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    common = ["evaluate", "CloseBox", "--assets", "builtin", "--episodes", "2", "--workers", "1"]
    told = tmp_path / "told.json"
    words = ["--controller", f"{CONTROLLERS}:Looks", "--out", str(tmp_path / "run"), "--json", str(told)]
    words += ["--videos", "1"]
    assert run([*common, *words]) == 0
    (task,) = (found := json.loads(told.read_text()))["tasks"]
    assert (task["name"], task["episodes"], task["held_mean"]) == ("CloseBox", 2, 0.0)
    assert len(task["held_interval"]) == 2
    assert len(task["records"]) == 2
    assert found["controller"]["observation"]["cloud"]["points"] == 64
    assert found["controller"]["privileged"] is False
    assert found["arguments"]["stop"] == "goal"
    (film,) = found["videos"]["CloseBox"]
    picture = imageio.get_reader(film).get_data(0)
    assert picture.shape == (SIZE, 2 * SIZE, 3)
    dots = (np.abs(picture[:, SIZE:].astype(int) - PAPER).max(axis=-1) > 60).sum()  # 64 points, some behind others
    assert 64 < dots < 64 * (2 * DOT + 1) ** 2
    assert run([*common, *words, "--resume"]) == 0
    words[-1] = "2"  # one more video than in the first run
    assert run([*common, *words, "--resume"]) == 0
    assert json.loads(told.read_text())["tasks"][0]["records"] == task["records"]
    assert len(json.loads(told.read_text())["videos"]["CloseBox"]) == 2
    words[1] = f"{CONTROLLERS}:Rest"
    assert run([*common, *words, "--resume"]) == 2
    assert "controller" in capfd.readouterr().err
    assert run([*common, "--controller", f"{CONTROLLERS}:Nan", "--out", str(tmp_path / "nan")]) == 2
    (line,) = [each for each in capfd.readouterr().err.splitlines() if each.startswith("gensim2:")]
    assert "Nan: CloseBox, episode 0, seed " in line
    assert "must be finite" in line


def test_the_planner_is_one_of_them_on_the_scenes_of_the_benchmark(tmp_path: Path) -> None:
    common = {"episodes": 2, "runs": 1, "assets": "builtin", "workers": 1}
    spec: ControllerSpec = planner_spec(load_task("CloseBox"), load_strategies("CloseBox"), DEFAULT_ROLLOUT, "panda")
    mine = gensim2.evaluate(spec, "CloseBox", stop="controller", out=tmp_path / "mine", **common)  # type: ignore[arg-type]
    theirs = gensim2.benchmark(["CloseBox"], out=tmp_path / "theirs", **common)  # type: ignore[arg-type]
    assert mine.rows[0].episodes == theirs.rows[0].episodes
    assert mine.controller["privileged"]
    for result in (mine, theirs):
        assert len(repr(result)) < 1000
        assert "TaskRow(task='CloseBox', runs=1, episodes=2, paper=1.00, held=1.00" in repr(result)


def test_what_cannot_be_evaluated_is_refused_before_anything_starts(tmp_path: Path) -> None:
    for given, words in (
        ({"controller": f"{CONTROLLERS}:Nobody"}, "has no class"),
        ({"arguments": {"minutes": 3}}, "cannot be made"),
        ({"stop": "never"}, "unknown value"),
        ({"data": tmp_path}, "dataset.json"),
    ):
        arguments = {"controller": f"{CONTROLLERS}:Rest", "tasks": "CloseBox", "assets": "builtin", **given}
        with pytest.raises(InputError, match=words):
            gensim2.evaluate(out=tmp_path / "out", **arguments)  # type: ignore[arg-type]
    assert not (tmp_path / "out").exists()
    with pytest.raises(ControllerError, match="inside a function"):
        gensim2.evaluate(type("Local", (), {"__qualname__": "f.<locals>.Local"}), "CloseBox", assets="builtin")


@pytest.mark.parametrize(("stop", "shown"), [("controller", True), ("goal", False)])
def test_time_over_names_the_guide_if_the_controller_must_stop(
    stop: str, shown: bool, capfd: pytest.CaptureFixture[str]
) -> None:
    row: dict[str, Any] = {
        "name": "CloseBox", "episodes": 5, "different_objects": 5, "causes": {Cause.TIME_OVER.value: 2},
        **{f"{verdict}_mean": 0.6 for verdict in ("success", "held", "strict")},
        **{f"{verdict}_interval": (0.23, 0.88) for verdict in ("success", "held", "strict")},
    }  # fmt: skip
    told: dict[str, Any] = {
        "tasks": [row],
        "episodes_per_second": {"CloseBox": None},
        "controller": {"target": "mine.py:Policy", "arguments": {"url": "ws://127.0.0.1:8321"}},
    }
    command._show(told | {"arguments": {"stop": stop}, "skipped": {}, "videos": {}, "cpu_s": 1.0, "run_dir": "run"})
    page, _, place = command.STOP_GUIDE.partition("#")
    printed = capfd.readouterr().out
    assert "mine.py:Policy(url='ws://127.0.0.1:8321')" in printed
    assert ("time over: the controller did not stop" in printed) == shown
    assert f"## {place.replace('-', ' ').capitalize()}" in (Path(__file__).parents[2] / page).read_text()


def table(out: Path, *words: str) -> dict[str, Any]:
    file = out.with_suffix(".json")
    assert run([*words, "--out", str(out), "--json", str(file)]) == 0
    found: dict[str, Any] = json.loads(file.read_text())
    return found


def test_both_engines_run_the_same_scenes_and_are_compared(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    words = ["benchmark", "CloseBox", "--assets", "builtin", "--runs", "1", "--episodes", "2", "--engines", "both"]
    both = table(tmp_path / "both", *words)
    alone = table(tmp_path / "alone", *words[:-2], "--engine", "mujoco")
    assert list(both["engines"]) == ["sapien", "mujoco"]
    assert both["engines"]["mujoco"]["tasks"] == alone["tasks"]
    one, other = (each["tasks"][0]["records"] for each in both["engines"].values())
    assert one != other
    assert [record["seed"] for record in one] == [record["seed"] for record in other]
    pairs = [(record["seed"], record["held"], again["held"]) for record, again in zip(one, other, strict=True)]
    (compared,) = both["compared"]
    assert compared["held"] == [sum(pair[1] for pair in pairs), sum(pair[2] for pair in pairs)]
    assert compared["lost"] == [seed for seed, held, again in pairs if held and not again]
    assert compared["won"] == [seed for seed, held, again in pairs if again and not held]
    assert compared["p_value"] == 1.0
    assert "held in sapien" in capfd.readouterr().out
    assert table(tmp_path / "both", *words, "--resume")["compared"] == both["compared"]
    for engine in ("sapien", "mujoco"):
        assert (tmp_path / "both" / engine / "run.json").is_file()
    assert run([*words, "--physics", "original", "--out", str(tmp_path / "refused")]) == 2

"""Inputs of ``demo`` and ``solve``: checked before anything starts, and planned as in episodes."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml
from drawer_task import OPEN_DRAWER

from gensim2.cli.main import FOUND_WRONG, run
from gensim2.data.runfolder import TaskFolder
from gensim2.core.errors import InputError
from gensim2.rollout.inputs import read_task_input, task_and_strategies
from gensim2.rollout.solving import solve
from gensim2.tasks.library import load_strategies, load_task, task_names

pytest.importorskip("mani_skill")

SIMULATOR = True


def _config() -> dict[str, Any]:
    """Return the strategy of the task that these tests change."""
    return load_strategies("OpenDrawer")["open_drawer_from_above"]


def _copy(path: Path) -> Path:
    """Return a copy of a library task's folder with its shared strategies."""
    TaskFolder(path).write_strategies(load_strategies("OpenDrawer"))
    TaskFolder(path).write_task(load_task("OpenDrawer"))
    return path


def _folder(path: Path, config: dict[str, Any], **task: Any) -> Path:
    fields = load_task("OpenDrawer").model_dump(mode="json", exclude_none=True) | {"provenance": None} | task
    fields["steps"][0]["strategies"] = ["pull"]
    TaskFolder(path).write_strategies({"pull": config})
    (path / "task.yaml").write_text(yaml.safe_dump(fields))
    return path


@pytest.mark.parametrize(
    ("field", "old", "new", "words"),
    [
        ("keypoint_name", "tool_head", "tool_hed", 'tool_keypoints: has no "tool_hed"'),
        ("target_keypoint_name", "articulated_object_head", "knob", 'object_keypoints: has no "knob"'),
        ("target_keypoint_name", "articulated_object_head", "lemon/lemon_top", 'has no "lemon/lemon_top"'),
    ],
)
def test_a_keypoint_that_nobody_has_is_named(tmp_path: Path, field: str, old: str, new: str, words: str) -> None:
    config = _config()
    assert config["constraint_list"][0][field] == old
    config["constraint_list"][0][field] = new
    folder = _folder(tmp_path / "task", config)
    with pytest.raises(InputError) as caught:
        read_task_input(str(folder), assets="builtin", instances="all", seed=0)
    assert str(caught.value).startswith(str(folder / "strategies/pull.yaml"))
    assert words in str(caught.value)


def test_a_keypoint_may_be_told_with_its_object(tmp_path: Path) -> None:
    config = _config()
    config["constraint_list"][0]["target_keypoint_name"] = "drawer/articulated_object_head"
    assert read_task_input(str(_folder(tmp_path / "task", config)), assets="builtin", instances="all", seed=0).strategies["pull"] == config


def test_every_library_strategy_fits_its_classes() -> None:
    for name in task_names("paper"):
        given = read_task_input(name, assets="builtin", instances="all", seed=0)
        assert given.spec.name == name
        assert given.instances == "all"


def test_random_is_one_object_drawn_by_the_seed() -> None:
    words = [read_task_input("OpenDrawer", assets="builtin", instances="random", seed=seed).instances for seed in (0, 0, 1, 2, 3)]
    assert all(word.isdecimal() for word in words)
    assert words[0] == words[1]
    assert len(set(words)) > 1


def test_a_word_means_the_same_of_tasks_with_rigid_objects() -> None:
    task = "PlaceGolfBallIntoDrawer"
    for word in ("all", "train", "test", "new", "3"):
        assert read_task_input(task, assets="builtin", instances=word, seed=0).instances == word
    assert read_task_input(task, assets="builtin", instances="random", seed=4).instances in read_task_input(
        task, assets="builtin", instances="all", seed=4
    ).library.instances("drawer")
    with pytest.raises(InputError, match="no instance 'x' of drawer"):
        read_task_input(task, assets="builtin", instances="x", seed=0)


def test_a_strategy_that_nobody_takes(tmp_path: Path) -> None:
    for number, (config, words) in enumerate(
        [
            ({}, "constraint_list: is missing"),
            ({"constraint_list": []}, "constraint_list: has no constraint"),
            ({**_config(), "speed": 3}, "speed: is not a known field"),
            ({"grasp": "antipodal", "aproach": 0.1}, "did you mean 'approach'?"),
            ({"grasp": "antipodal"}, "but drawer has a joint"),
        ]
    ):
        folder = _folder(tmp_path / str(number), config)
        with pytest.raises(InputError) as caught:
            read_task_input(str(folder), assets="builtin", instances="all", seed=0)
        assert str(caught.value).startswith(f"{folder / 'strategies/pull.yaml'}: ")
        assert words in str(caught.value)


@pytest.mark.parametrize(("field", "word"), [("physics", "newtonian"), ("robot", "r2d2"), ("randomization", "none")])
def test_physics_robots_and_randomizations_that_there_are_not(field: str, word: str) -> None:
    with pytest.raises(InputError, match=f"{field}: (no|unknown) {field} .*{word}"):
        read_task_input("OpenDrawer", assets="builtin", instances="all", seed=0, **{field: word})


def test_a_name_and_a_folder_are_read_alike(tmp_path: Path) -> None:
    folder = _copy(tmp_path / "task")
    assert task_and_strategies(str(folder)) == task_and_strategies("OpenDrawer")


def test_a_folder_of_version_1_is_read(tmp_path: Path) -> None:
    task = {
        "schema_version": 1,
        "name": "PullDrawer",
        "description": "pull the drawer open",
        "asset_class": "drawer",
        "success": [{"type": "articulated_open", "threshold": 0.8}],
    }
    (tmp_path / "task.yaml").write_text(yaml.safe_dump(task))
    (tmp_path / "solver.yaml").write_text(yaml.safe_dump(_config()))
    given = read_task_input(str(tmp_path), assets="builtin", instances="all", seed=0)
    assert given.spec.is_single_step
    assert given.strategies == {"solver": _config()}


def test_a_task_whose_whole_motion_cannot_be_had_is_partial_not_unsolvable(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The last keyframe is 1.5 m to the side and cannot be reached."""
    folder = tmp_path / "task"
    shutil.copytree(OPEN_DRAWER, folder)
    strategy = yaml.safe_load((folder / "strategies" / "pull.yaml").read_text())
    strategy["post_actuation_motions"] = [["follow_joint_to", 0.9], ["translate_y", 1.5]]
    (folder / "strategies" / "pull.yaml").write_text(yaml.safe_dump(strategy))
    assert run(["solve", str(folder), "--seed", "0", "--assets", "builtin", "--out", str(tmp_path / "out")]) == 0
    shown = capfd.readouterr().out
    assert "OpenDrawer on drawer/" in shown
    assert ": partial" in shown
    (step,) = json.loads((tmp_path / "out" / "plan.json").read_text())["steps"]
    plan, part = step["plan"], step["part"]
    assert plan["status"] == "partial"
    assert part["status"] == "solved"
    assert part["keyframes"][-1]["label"] == "let_go"
    missed = [frame for frame in plan["keyframes"] if not frame["reached"]]
    assert [frame["time"] for frame in missed] == [None] * len(missed)
    assert missed


def test_solve_of_a_folder_is_solve_of_the_task(tmp_path: Path) -> None:
    folder = _copy(tmp_path / "task")
    by_folder = solve(str(folder), seed=1, assets="builtin").to_dict()
    by_name = solve("OpenDrawer", seed=1, assets="builtin").to_dict()
    for result in (by_folder, by_name):
        for step in result["steps"]:
            step["plan"].pop("cpu_ms", None)
    assert by_folder == by_name
    assert [step["name"] for step in by_name["steps"]] == ["open"]


def test_the_repr_of_a_result_of_solve_is_short() -> None:
    words = repr(solve("OpenDrawer", seed=1, assets="builtin"))
    assert len(words) < 1000
    for part in ("task='OpenDrawer'", "name='open'", "strategy=", "status=", "'solved'", "reason="):
        assert part in words


def test_no_plan_at_all_ends_with_1(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    config = _config()
    config["constraint_list"][0]["target_offset"] = [0.0, 0.0, 5.0]
    config["constraint_list"][0]["target_offset_frame"] = "world"
    folder = _folder(tmp_path / "task", config)
    assert run(["solve", str(folder), "--assets", "builtin"]) == FOUND_WRONG
    assert "partial" not in capfd.readouterr().out

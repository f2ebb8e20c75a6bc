"""What ``demo`` and ``solve`` are given: checked as a whole before anything starts, and planned as episodes do."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from gensim2.cli.main import FOUND_WRONG, run
from gensim2.errors import InputError
from gensim2.pipeline.inputs import read_task_input, task_and_config
from gensim2.pipeline.solving import solve
from gensim2.planning.config import check_keypoints, solver_config
from gensim2.tasks.library import load_config, load_task

pytest.importorskip("mani_skill")

SIMULATOR = True


def _folder(path: Path, config: dict[str, Any], **task: Any) -> Path:
    fields = load_task("OpenDrawer").model_dump(mode="json", exclude_none=True) | task
    path.mkdir()
    (path / "task.yaml").write_text(yaml.safe_dump(fields))
    (path / "solver.yaml").write_text(yaml.safe_dump(config))
    return path


@pytest.mark.parametrize(
    ("field", "old", "new", "words"),
    [
        ("keypoint_name", "tool_head", "tool_hed", 'tool_keypoints: has no "tool_hed"'),
        ("target_keypoint_name", "articulated_object_head", "knob", 'object_keypoints: has no "knob"'),
    ],
)
def test_a_keypoint_that_nobody_has_is_named(tmp_path: Path, field: str, old: str, new: str, words: str) -> None:
    config = load_config("OpenDrawer")
    assert config["constraint_list"][0][field] == old
    config["constraint_list"][0][field] = new
    folder = _folder(tmp_path / "task", config)
    with pytest.raises(InputError) as caught:
        read_task_input(str(folder), "builtin", "all", 0)
    assert str(caught.value).startswith(f"{folder / 'solver.yaml'}: {words}")


def test_every_library_config_fits_its_class() -> None:
    for name in ("OpenDrawer", "OpenBox", "TurnOnFaucet"):
        given = read_task_input(name, "builtin", "all", 0)
        assert given.spec.name == name
        assert given.instances == "all"


def test_random_is_one_object_drawn_by_the_seed() -> None:
    words = [read_task_input("OpenDrawer", "builtin", "random", seed).instances for seed in (0, 0, 1, 2, 3)]
    assert all(word.isdecimal() for word in words)
    assert words[0] == words[1]
    assert len(set(words)) > 1


def test_a_config_that_no_solver_takes(tmp_path: Path) -> None:
    for config, words in [
        ({}, "constraint_list: is missing"),
        ({"constraint_list": []}, "constraint_list: holds no constraint"),
        ({**load_config("OpenDrawer"), "speed": 3}, "speed: is not a known field"),
        ({"task_name": "\ud800"}, "half a character"),
        ({"constraint_list": [{"type": "point2point_constraint", "tolerance": 10**400}]}, "beyond 1e308"),
    ]:
        with pytest.raises(InputError) as caught:
            solver_config(config, tmp_path / "solver.yaml")
        assert str(caught.value).startswith(f"{tmp_path / 'solver.yaml'}: ")
        assert words in str(caught.value)


def test_two_keypoints_of_an_object_are_enough_for_a_config_that_names_them() -> None:
    config = solver_config(load_config("OpenDrawer"))
    check_keypoints(config, ["articulated_object_tail", "articulated_object_head"], "prismatic")
    with pytest.raises(InputError, match="articulated_object_head"):
        check_keypoints(config, ["articulated_object_tail"], "prismatic")


def test_a_name_and_a_folder_are_read_alike(tmp_path: Path) -> None:
    folder = _folder(tmp_path / "task", load_config("OpenDrawer"))
    assert task_and_config(str(folder)) == task_and_config("OpenDrawer")


def test_a_task_whose_whole_motion_cannot_be_had_is_partial_not_unsolvable(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Episodes of this seed succeed; the last keyframe, beyond closed, cannot be reached."""
    assert run(["solve", "CloseLaptop", "--seed", "0", "--assets", "builtin", "--out", str(tmp_path / "out")]) == 0
    shown = capfd.readouterr().out
    assert "CloseLaptop on laptop_rotate/" in shown
    assert ": partial" in shown
    plan = json.loads((tmp_path / "out" / "plan.json").read_text())["plan"]
    assert plan["status"] == "partial"
    missed = [frame for frame in plan["keyframes"] if not frame["reached"]]
    assert [frame["time"] for frame in missed] == [None] * len(missed)
    assert missed


def test_solve_of_a_folder_is_solve_of_the_task(tmp_path: Path) -> None:
    folder = _folder(tmp_path / "task", load_config("OpenDrawer"))
    by_folder = solve(str(folder), seed=1, assets="builtin").to_dict()
    by_name = solve("OpenDrawer", seed=1, assets="builtin").to_dict()
    for result in (by_folder, by_name):
        result["plan"].pop("cpu_ms", None)
    assert by_folder == by_name


def test_no_plan_at_all_ends_with_1(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    config = load_config("OpenDrawer")
    config["constraint_list"][0]["target_offset"] = [0.0, 0.0, 5.0]
    config["constraint_list"][0]["target_offset_frame"] = "world"
    folder = _folder(tmp_path / "task", config)
    assert run(["solve", str(folder), "--assets", "builtin"]) == FOUND_WRONG
    assert "partial" not in capfd.readouterr().out

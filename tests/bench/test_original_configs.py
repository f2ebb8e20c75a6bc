"""The original's configs as a benchmark: the selected records, their scenes and the published figures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mani_skill")

from original_configs import ROBOT, Rate, _groups, _recorded, _release_of, benchmark_configs, differ, main
from tests.common.pushing_config import CONFIG

from gensim2.bench.problems import read_problems
from gensim2.core.errors import InputError
from gensim2.objects import open_library
from gensim2.robots import robot
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.published import MEASURED


def a_record(**changes: Any) -> dict[str, Any]:
    """Return a record of a generated drawer that is half open in front of the robot."""
    env = HeadlessEnv("PushDrawerClose", assets="builtin", robot=ROBOT)
    env.reset(5)
    thing = env.initial_state.objects["drawer"]
    scene = env.scene_state().objects["drawer"]
    joint = thing.model.joint  # type: ignore[union-attr]
    times = ("actuation_time", "pre_actuation_times", "post_actuation_times")
    return {
        "id": "PushDrawerClose/PushDrawerClose/0",
        "task": "PushDrawerClose",
        "sub_task": "PushDrawerClose",
        "objects": {
            "articulated": {
                "cls": "drawer",
                "id": thing.model.id,
                "root_p": thing.position.tolist(),
                "root_q": thing.quaternion.tolist(),
                "qpos": [thing.joint_value],
                "close_qpos": joint.lower,
                "open_qpos": joint.upper,
                "scale": 1.0,
            }
        },
        "config": {name: value for name, value in CONFIG.items() if name not in times},
        **{name: CONFIG[name] for name in times},
        "start_time": 0,
        "q_current": list(robot(ROBOT).reset_qpos),
        "T_world_base": robot(ROBOT).T_world_base.tolist(),
        "T_base_object": scene.T_base_object.tolist(),
        "tool_keypoints_hand": {name: point.tolist() for name, point in robot(ROBOT).tool_keypoints.items()},
        "object_keypoints_base": {name: point.tolist() for name, point in scene.keypoints.items()},
        "object_yaw": 0.3,
        "object_axis": "z",
        **changes,
    }


def written(folder: Path, *records: dict[str, Any]) -> Path:
    file = folder / "plans.jsonl"
    file.write_text("".join(f"{json.dumps(record)}\n" for record in records))
    return file


def test_a_recorded_scene_is_the_record_s(tmp_path: Path) -> None:
    record = a_record()
    (problem,) = read_problems(written(tmp_path, record))
    library = open_library("builtin")
    groups, left_out = _groups([problem], library, (), tmp_path)
    assert not left_out
    group = groups["PushDrawerClose"]
    plan = _recorded(group.spec, problem, library)
    env = HeadlessEnv(group.spec, assets="builtin", physics="original", robot=ROBOT)
    env.reset(0, plan.options)
    thing = env.scene_state().objects["drawer"]
    for name, point in record["object_keypoints_base"].items():
        assert np.abs(thing.keypoints[name] - point).max() < 1e-5
    assert np.abs(thing.T_base_object - record["T_base_object"]).max() < 1e-5
    assert plan.object_yaw == 0.3


def test_what_is_not_run_is_named(tmp_path: Path) -> None:
    record = a_record()
    articulated = record["objects"]["articulated"]
    moved = [0.5, *record["q_current"][1:]]
    file = written(
        tmp_path,
        record,
        {**record, "id": "a", "objects": {"articulated": {**articulated, "id": "none"}}},
        {**record, "id": "b", "task": "PlaceLemonIntoDrawer", "q_current": moved},
        {**record, "id": "c", "task": "PlaceLemonIntoDrawer", "sub_task": "ReachBall"},
        {**record, "id": "d", "task": "PlaceLemonIntoDrawer"},
    )
    groups, left_out = _groups(read_problems(file), open_library("builtin"), (), file)
    assert left_out == {
        "a": "there is no drawer/none",
        "b": "does not begin at the start of an episode of PlaceLemonIntoDrawer",
        "c": "ReachBall is a step of PlaceLemonIntoDrawer, not a separate task",
    }
    assert {name: (len(group.problems), group.release) for name, group in groups.items()} == {
        "PushDrawerClose": (1, Rate(9, 10)),
        "PlaceLemonIntoDrawer-PushDrawerClose": (1, None),
    }
    head = {**record["tool_keypoints_hand"], "tool_head": [0.0, 0.0, 0.105]}
    other = written(tmp_path, {**record, "tool_keypoints_hand": head})
    with pytest.raises(InputError, match=r"tool_keypoints_hand: .* tool_head differs from the profile panda_long"):
        _groups(read_problems(other), open_library("builtin"), (), other)


def test_a_file_of_which_nothing_can_be_run_says_what_is_missing(tmp_path: Path) -> None:
    record = a_record()
    articulated = record["objects"]["articulated"]
    library = open_library("builtin")
    for lacks in ({"id": "none"}, {"cls": "apple", "id": "0"}):
        file = written(tmp_path, {**record, "objects": {"articulated": {**articulated, **lacks}}})
        with pytest.raises(InputError, match=r"assets: .* has no object of .*: there is no .*original's objects"):
            _groups(read_problems(file), library, (), file)
    file = written(tmp_path, record)
    with pytest.raises(InputError, match=r"tasks: contains no config of these tasks \(choose from PushDrawerClose\)"):
        _groups(read_problems(file), library, ("OpenDrawer",), file)
    with pytest.raises(InputError, match="did you mean OpenDrawer"):
        _groups(read_problems(file), library, ("OpenDrwer",), file)
    still = {**articulated, "close_qpos": articulated["open_qpos"]}
    file = written(tmp_path, {**record, "objects": {"articulated": still}})
    with pytest.raises(InputError, match="the joint has no range"):
        read_problems(file)
    file = written(tmp_path, {**record, "task": "PlaceLemonIntoDrawer"})
    with pytest.raises(InputError, match="scenes: holds no task whose release figure is known"):
        benchmark_configs((), configs=file, scenes="drawn", assets="builtin", workers=0)


def test_the_command_runs_the_file_and_sets_rates_beside_the_release_s(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = written(tmp_path, a_record()), tmp_path / "run"
    words = [str(file), "--assets", "builtin", "--workers", "1"]
    assert main([*words, "--out", str(out), "--json", str(tmp_path / "o.json")]) == 0
    found = json.loads((tmp_path / "o.json").read_text())
    (row,) = found["tasks"]
    assert found["arguments"]["physics"] == "original"
    assert (row["paper"]["of"], row["release"]["count"], row["release"]["of"]) == (1, 9, 10)
    assert row["records"][0]["id"] == "PushDrawerClose/PushDrawerClose/0"
    assert list(row["instances"]) == [f"drawer/{row['records'][0]['objects']['drawer']['id']}"]
    assert set(found["provenance"]) == {"commit", "date", "command"}
    assert "PushDrawerClose" in capsys.readouterr().out


def test_some_tasks_are_set_beside_the_release_s_figures_of_these() -> None:
    assert _release_of([]) is None
    found = _release_of(["OpenLaptop", "TurnOffFaucet"])
    assert found is not None
    assert (found.count, found.of) == (7, 20)
    whole = _release_of(list(MEASURED))
    assert whole is not None
    assert (whole.count, whole.of) == (556, 720)


def test_equal_rates_differ_by_chance_and_others_do_not() -> None:
    assert differ(Rate(9, 10), Rate(27, 30)) == pytest.approx(1.0)
    assert (differ(Rate(2, 30), Rate(9, 10)) or 1.0) < 1e-4
    assert differ(Rate(0, 0), Rate(9, 10)) is None

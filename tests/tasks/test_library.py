"""The task library, and the errors of task files."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from gensim2.core.errors import InputError
from gensim2.tasks.criteria import ArticulatedOpen, DistanceArticulatedRigid, all_hold
from gensim2.tasks.library import (
    load_strategies,
    load_strategies_beside,
    load_task,
    load_task_file,
    strategy_files,
    task_folder,
    task_names,
)
from gensim2.tasks.measurement import Measurement
from gensim2.tasks.parse import parse_task
from gensim2.tasks.spec import Place, Randomization, TaskSpec

GOOD = """
schema_version: 2
name: FillCrate
description: put the ball into the crate
objects:
  crate:
    class: crate
    randomization:
      x: 0.05
      y: [0.0, 0.1]
  ball:
    class: golf_ball
    place:
      on: crate
      at: [0.1, 0.2]
steps:
  - name: open
    object: crate
    strategies: [lift, pry]
    done:
      - type: articulated_open
        object: crate
        threshold: 0.8
  - name: place
    object: crate
    tool: ball
    strategies: [drop]
goal:
  - type: distance_articulated_rigidbody
    articulated: crate
    rigid: ball
"""
#: The format from before tasks had several objects.
FORMER = """
name: OpenCrate
description: open the crate
asset_class: crate
success:
  - type: articulated_open
    threshold: 0.8
"""


def _measured(openness: float, **names: str) -> Measurement:
    (name,) = names.values()
    return Measurement({name: openness}, {name: 0.0}, {name: {}}, {}, {}, {}, 0.08)


def test_library_holds_the_eight_tasks() -> None:
    assert set(task_names("paper")) >= {
        "OpenBox",
        "CloseBox",
        "OpenLaptop",
        "CloseLaptop",
        "OpenDrawer",
        "PushDrawerClose",
        "OpenSafe",
        "TurnOnFaucet",
    }


@pytest.mark.parametrize("name", task_names("paper"))
def test_every_task_is_valid_and_not_done_at_the_mean_openness(name: str) -> None:
    task = load_task(name)
    assert task.name == name
    role = task.steps[0].object
    assert role != "object"  # a readable name
    if task.is_single_step:
        assert not all_hold(task.success, _measured(0.5, role=role))
        opening = isinstance(task.success[0], ArticulatedOpen)
        assert all_hold(task.success, _measured(0.95 if opening else 0.05, role=role))


@pytest.mark.parametrize("name", task_names("paper"))
def test_every_step_has_its_strategies(name: str) -> None:
    strategies = load_strategies(name)
    named = [strategy for step in load_task(name).steps for strategy in step.strategies]
    assert list(strategies) == list(dict.fromkeys(named))
    assert all(strategies.values())


def test_unknown_task_names_near_matches() -> None:
    with pytest.raises(InputError, match=r"unknown task 'OpenDrawr' \(did you mean OpenDrawer"):
        load_task("OpenDrawr")
    with pytest.raises(InputError, match="gensim2 tasks list"):
        load_strategies("Zzz")


def test_json_round_trip_keeps_the_spec(tmp_path: Path) -> None:
    path = tmp_path / "task.yaml"
    path.write_text(GOOD)
    for task in (load_task("OpenBox"), load_task_file(path)):
        assert parse_task(task.model_dump(mode="json")) == task


def test_a_task_file_loads(tmp_path: Path) -> None:
    path = tmp_path / "task.yaml"
    path.write_text(GOOD)
    task = load_task_file(path)
    assert isinstance(task, TaskSpec)
    assert list(task.objects) == ["crate", "ball"]
    assert task.objects["crate"].randomization == Randomization(x=(-0.05, 0.05), y=(0.0, 0.1))
    assert task.objects["ball"].place == Place(on="crate", at=(0.1, 0.2))
    assert task.success == (DistanceArticulatedRigid(articulated="crate", rigid="ball"),)
    assert [step.tool for step in task.steps] == ["hand", "ball"]
    assert load_task_file(tmp_path) == task  # the folder may be given


def test_a_file_of_version_1_is_a_task_of_one_object_and_one_step(tmp_path: Path) -> None:
    path = tmp_path / "task.yaml"
    for text in (FORMER, FORMER + "schema_version: 1\n", FORMER + "randomization: {x: 0.2, openness_mean: 0.4}\n"):
        path.write_text(text)
        task = load_task_file(path)
        assert task.schema_version == 2
        assert list(task.objects) == ["object"]
        assert task.objects["object"].asset_class == "crate"
        assert task.is_single_step
        assert task.success == (ArticulatedOpen(object="object", threshold=0.8),)
        assert task.steps[0].strategies == ("solver",)
    assert task.objects["object"].randomization == Randomization(x=(-0.2, 0.2), openness_mean=0.4)
    (tmp_path / "solver.yaml").write_text("gripper: open\n")
    assert load_strategies_beside(path, task) == {"solver": {"gripper": "open"}}


def test_strategies_lie_beside_their_task_and_a_missing_one_is_named(tmp_path: Path) -> None:
    (tmp_path / "task.yaml").write_text(GOOD)
    folder = tmp_path / "strategies"
    folder.mkdir()
    for name in ("lift", "pry", "dropp"):
        (folder / f"{name}.yaml").write_text(f"gripper: {'open' if name == 'pry' else 'closed'}\n")
    task = load_task_file(tmp_path)
    with pytest.raises(InputError, match=r"drop\.yaml: a step names a strategy 'drop' .*did you mean dropp"):
        load_strategies_beside(tmp_path, task)
    (folder / "dropp.yaml").rename(folder / "drop.yaml")
    for place in (tmp_path, tmp_path / "task.yaml"):
        found = load_strategies_beside(place, task)
        assert list(found) == ["lift", "pry", "drop"]
        assert found["pry"] == {"gripper": "open"}


def test_a_step_without_strategies_uses_none_of_the_package(tmp_path: Path) -> None:
    (tmp_path / "task.yaml").write_text(GOOD.replace("    strategies: [drop]\n", ""))
    (tmp_path / "strategies").mkdir()
    for name in ("lift", "pry"):
        (tmp_path / "strategies" / f"{name}.yaml").write_text("gripper: open\n")
    expected = r"task\.yaml: steps\.place\.strategies: the step has no strategy yet \(`gensim2 design .*` finds one"
    with pytest.raises(InputError, match=expected):
        load_strategies_beside(tmp_path, load_task_file(tmp_path))


def test_a_strategy_that_is_not_beside_its_task_is_one_that_tasks_share(tmp_path: Path) -> None:
    (tmp_path / "task.yaml").write_text(GOOD.replace("[drop]", "[grasp]"))
    folder = tmp_path / "strategies"
    folder.mkdir()
    for name in ("lift", "pry"):
        (folder / f"{name}.yaml").write_text("gripper: open\n")
    task = load_task_file(tmp_path)
    assert load_strategies_beside(tmp_path, task)["grasp"] == {"grasp": "antipodal"}
    (folder / "grasp.yaml").write_text("gripper: grasp\n")  # its own strategy comes first
    assert load_strategies_beside(tmp_path, task)["grasp"] == {"gripper": "grasp"}
    (folder / "grasp.yaml").rename(folder / "other.yaml")
    (tmp_path / "task.yaml").write_text(GOOD.replace("[drop]", "[grapsp]"))
    with pytest.raises(InputError, match=r"'grapsp' .*did you mean grasp"):
        load_strategies_beside(tmp_path, load_task_file(tmp_path))


def test_shared_strategies_are_used_and_no_task_has_a_file_of_its_own_by_such_a_name() -> None:
    library = task_folder("OpenDrawer").parent  # type: ignore[attr-defined]
    shared = {file.name for file in (library / "strategies").iterdir()}
    files = [
        file for name in task_names("paper") for file in strategy_files(task_folder(name), load_task(name)).values()
    ]
    named = {file.name for file in files if file.parent == library / "strategies"}  # type: ignore[attr-defined]
    assert shared == named
    assert not {file.name for file in library.glob("*/strategies/*.yaml")} & shared


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (FORMER + "colour: red\n", "colour: unknown field (remove it)"),
        (FORMER + "sucess: []\n", "did you mean 'success'"),
        (FORMER.replace("0.8", ".nan"), "success.0.threshold: must be a finite number, but is nan"),
        (FORMER.replace("0.8", ".inf"), "success.0.threshold: must be a finite number, but is inf"),
        (FORMER.replace("0.8", "'0.8'"), "success.0.threshold: "),
        (FORMER.replace("0.8", "1.5"), "success.0.threshold: "),
        (FORMER.replace("threshold", "thresold"), "success.0.thresold: unknown field (did you mean 'threshold'?)"),
        (FORMER.replace("articulated_open", "articulated_ajar"), "success.0.type: "),
        (FORMER.replace("name: OpenCrate", "name: open crate"), "name: "),
        (FORMER.replace("asset_class: crate\n", ""), "asset_class: field required"),
        (FORMER[: FORMER.index("success")], "success: field required"),
        (FORMER[: FORMER.index("success")] + "success: []\n", "success: must contain at least one criterion"),
        (FORMER + "randomization: {yaww: 1}\n", "randomization.yaww: unknown field (did you mean 'yaw'?)"),
        (FORMER + "name: Twice\n", "given twice"),
        (FORMER + "schema_version: 2\n", "schema_version: must be 1"),
        (FORMER.replace("open the crate", "2026-11-21"), "type"),
        (GOOD + "colour: red\n", "colour: unknown field (remove it)"),
        (GOOD + "gaol: []\n", "gaol: unknown field (did you mean 'goal'?)"),
        (GOOD.replace("    class: crate", "    clas: crate"), "objects.crate.clas"),
        (GOOD.replace("    class: crate", "    class: crate\n    instances: 3"), "objects.crate.instances"),
        (GOOD.replace("    class: crate", "    class: crate\n    instances: [1]"), "objects.crate.instances"),
        (GOOD.replace("    class: crate", "    class: crate\n    instances: {real: 3}"), "objects.crate.instances"),
        (GOOD.replace("randomization", "randomisation"), "crate.randomisation: unknown field (did you mean 'randomiz"),
        (GOOD.replace("x: 0.05", "xx: 0.05"), "objects.crate.randomization.xx: unknown field (did you mean 'x'?)"),
        (GOOD.replace("at: [", "att: ["), "objects.ball.place.att: unknown field (did you mean 'at'?)"),
        (GOOD.replace("tool: ball", "tol: ball"), "steps.1.tol: unknown field (did you mean 'tool'?)"),
        (GOOD.replace("threshold", "thresold"), "steps.0.done.0.thresold: unknown field (did you mean 'threshold'?)"),
        (GOOD.replace("rigid: ball", "rigd: ball"), "goal.0.rigid: field required"),
        (GOOD.replace("articulated_open", "articulated_ajar"), "steps.0.done.0.type: "),
        (GOOD.replace("threshold: 0.8", "threshold: 1.5"), "steps.0.done.0.threshold: "),
        (GOOD.replace("[0.0, 0.1]", "[0.1, 0.0]"), "randomization.y: the first number of a range must not exceed"),
        (GOOD.replace("x: 0.05", "x: true"), "objects.crate.randomization.x: "),
        (
            GOOD.replace("on: crate", "on: bench"),
            "objects.ball.place.on: no object before 'ball' has the name 'bench'",
        ),
        (GOOD.replace("tool: ball", "tool: bat"), "steps.place.tool: there is no object 'bat'"),
        (GOOD.replace("rigid: ball", "rigid: bat"), "names an unknown object 'bat'"),
        (GOOD[: GOOD.index("goal")], "goal: is required"),
        (GOOD.replace("  ball:", "  hand:").replace("ball", "hand"), "no object may have the name 'hand'"),
        (GOOD.replace("  ball:", "  Ball:"), "objects.Ball: string should match pattern"),
        (GOOD.replace("strategies: [drop]", "strategies: []"), "steps.1.strategies: "),
        (GOOD.replace("schema_version: 2", "schema_version: 3"), "schema_version: "),
        ("success: [\n", "is not valid YAML"),
        ("\tname: x", "is not valid YAML"),
        ("- a\n- b\n", "must be a mapping from field names to values"),
        ("", "must be a mapping from field names to values"),
    ],
)
def test_a_bad_task_file_gives_one_line_that_names_file_and_field(tmp_path: Path, text: str, expected: str) -> None:
    path = tmp_path / "task.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load_task_file(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert expected in message
    assert "\n" not in message


def test_missing_and_binary_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.yaml: cannot read: No such file"):
        load_task_file(tmp_path / "none.yaml")
    path = tmp_path / "binary.yaml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not UTF-8"):
        load_task_file(path)


def test_a_config_file_with_nan_names_the_field(tmp_path: Path) -> None:
    (tmp_path / "strategies").mkdir()
    task = load_task("CloseBox")
    path = tmp_path / "strategies" / f"{task.steps[0].strategies[0]}.yaml"
    path.write_text("constraint_list:\n  - tolerance: .nan\n")
    with pytest.raises(InputError, match=r"constraint_list\.0\.tolerance: must be a finite number"):
        load_strategies_beside(tmp_path, task)


@pytest.mark.parametrize("name", [name for name in task_names("paper") if load_task(name).is_single_step])
def test_nan_openness_is_never_a_success(name: str) -> None:
    task = load_task(name)
    assert not all_hold(task.success, _measured(float("nan"), role=task.steps[0].object))


@pytest.mark.parametrize("name", task_names("paper"))
def test_library_tasks_say_where_they_and_all_their_strategies_come_from(name: str) -> None:
    task = load_task(name)
    assert task.provenance is not None
    assert set(task.provenance.strategies) == set(load_strategies(name))


def test_provenance_of_a_strategy_that_no_step_has_is_refused() -> None:
    data = load_task("OpenBox").model_dump(mode="json")
    data["provenance"]["strategies"]["lft"] = {"by": "hand", "seen": "all"}
    with pytest.raises(InputError, match="no step has a strategy 'lft'"):
        parse_task(data)


@pytest.mark.parametrize("name", task_names("paper"))
def test_scenes_of_the_papers_tasks_have_the_originals_ranges(name: str) -> None:
    task = load_task(name)
    if task.provenance is None or task.provenance.origin != "paper":
        return
    long, third = not task.is_single_step, math.pi / 6
    for index, thing in enumerate(task.objects.values()):
        ranges, place = thing.randomization, thing.place
        if index > 0:  # the object put into the first
            at, turned = (-0.2, -0.45), -math.pi / 2 if thing.asset_class == "mug" else 0.0
            assert (ranges.x, ranges.y, ranges.yaw) == ((-0.1, 0.1), (-0.1, 0.1), third)
            assert (place.on, place.at, place.yaw) == ("table", at, turned)
            continue
        # Suitcases turn about an axis that points down in the original's default poses.
        turn = -third if thing.asset_class.startswith("suitcase") else third
        starts_closed = name in ("RelocateSuitcase", "PushToasterForward", "MoveBagForward")
        mean, spread = (0.0, 0.0) if starts_closed else (0.5 if long else None, 0.15)
        assert (ranges.x, ranges.y) == (((-0.05, 0.05), (0.0, 0.05)) if long else ((-0.1, 0.1), (-0.1, 0.1)))
        assert (ranges.yaw, ranges.openness_mean, ranges.openness_spread) == (turn, mean, spread)
        assert (place.on, place.at, place.yaw) == ("table", None, 0.0)

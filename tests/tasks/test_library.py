"""The task library and the errors that a task file can cause."""

from __future__ import annotations

from pathlib import Path

import pytest

from gensim2.errors import InputError
from gensim2.tasks.criteria import succeeded
from gensim2.tasks.library import (
    load_config,
    load_config_file,
    load_task,
    load_task_file,
    parse_task,
    task_names,
)
from gensim2.tasks.spec import TaskSpec

GOOD = """
name: OpenCrate
description: open the crate
asset_class: crate
success:
  - type: articulated_open
    threshold: 0.8
"""


def test_library_holds_the_eight_tasks() -> None:
    assert set(task_names()) >= {
        "OpenBox",
        "CloseBox",
        "OpenLaptop",
        "CloseLaptop",
        "OpenDrawer",
        "PushDrawerClose",
        "OpenSafe",
        "TurnOnFaucet",
    }


@pytest.mark.parametrize("name", task_names())
def test_every_task_is_valid_and_not_done_at_the_mean_openness(name: str) -> None:
    task = load_task(name)
    assert task.name == name
    assert not succeeded(task, 0.5)
    opening = task.success[0].type == "articulated_open"
    assert succeeded(task, 0.95 if opening else 0.05)


def test_unknown_task_names_near_matches() -> None:
    with pytest.raises(InputError, match=r"unknown task 'OpenDrawr' \(did you mean OpenDrawer"):
        load_task("OpenDrawr")
    with pytest.raises(InputError, match="known: "):
        load_config("Zzz")


def test_json_round_trip_keeps_the_spec() -> None:
    task = load_task("OpenBox")
    assert parse_task(task.model_dump(mode="json")) == task


def test_a_task_file_loads(tmp_path: Path) -> None:
    path = tmp_path / "task.yaml"
    path.write_text(GOOD)
    task = load_task_file(path)
    assert isinstance(task, TaskSpec)
    assert task.success[0].threshold == 0.8


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (GOOD + "colour: red\n", "colour: unknown field"),
        (GOOD + "sucess: []\n", "did you mean 'success'"),
        (GOOD.replace("0.8", ".nan"), "success.0.threshold: must be a finite number, is nan"),
        (GOOD.replace("0.8", ".inf"), "success.0.threshold: must be a finite number, is inf"),
        (GOOD.replace("0.8", "'0.8'"), "success.0.threshold: "),
        (GOOD.replace("0.8", "1.5"), "success.0.threshold: "),
        (GOOD.replace("articulated_open", "articulated_ajar"), "success.0.type: "),
        (GOOD.replace("name: OpenCrate", "name: open crate"), "name: "),
        (GOOD.replace("asset_class: crate\n", ""), "asset_class: field required"),
        (GOOD + "name: Twice\n", "given twice"),
        (GOOD + "schema_version: 2\n", "schema_version: "),
        (GOOD.replace("open the crate", "2026-11-21"), "type"),
        ("success: [\n", "is not valid YAML"),
        ("\tname: x", "is not valid YAML"),
        ("- a\n- b\n", "must hold fields by name"),
        ("", "must hold fields by name"),
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
    path = tmp_path / "solver.yaml"
    path.write_text("constraint_list:\n  - tolerance: .nan\n")
    with pytest.raises(InputError, match=r"constraint_list\.0\.tolerance: must be a finite number"):
        load_config_file(path)


def test_nan_openness_is_never_a_success() -> None:
    for name in task_names():
        assert not succeeded(load_task(name), float("nan"))

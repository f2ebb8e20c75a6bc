"""The reader of problem files: errors name the line and the field."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gensim2.bench.problems import PlanProblem, read_problems
from gensim2.core.errors import InputError

Spoil = Callable[[dict[str, Any]], None]
Parse = Callable[[str], PlanProblem]


@pytest.fixture
def parse(tmp_path: Path) -> Parse:
    """Return a function that reads a problem from line 7 of a file."""

    def read(line: str) -> PlanProblem:
        (tmp_path / "p.jsonl").write_text("\n" * 6 + line)
        return read_problems(tmp_path / "p.jsonl")[0]

    return read


def test_reads_in_order(problem_file: Path) -> None:
    problems = read_problems(problem_file)
    assert [problem.id for problem in problems] == ["CloseCabinet/0", "CloseCabinet/far"]
    assert problems[0].keyframe_times() == [16, 20, 24, 28, 32]
    assert problems[0].timed_config()["post_actuation_times"] == [28, 32]


@pytest.mark.parametrize(
    "field",
    [name for name, field in PlanProblem.model_fields.items() if field.is_required() and name != "object_axis"],
)
def test_a_missing_field_is_named(parse: Parse, problem: dict[str, Any], field: str) -> None:
    del problem[field]
    with pytest.raises(InputError, match=rf"p\.jsonl: line 7: {field}"):
        parse(json.dumps(problem))


def spoil_pose(problem: dict[str, Any]) -> None:
    problem["T_base_object"][0][0] = 2.0


def spoil_quaternion(problem: dict[str, Any]) -> None:
    problem["objects"]["articulated"]["root_q"] = [1.0, 1.0, 0.0, 0.0]


def enlarge_pose(problem: dict[str, Any]) -> None:
    problem["T_base_object"][0][0] = 1e200


def enlarge_quaternion(problem: dict[str, Any]) -> None:
    problem["objects"]["articulated"]["root_q"] = [1e200, 0.0, 0.0, 0.0]


def spoil_joints(problem: dict[str, Any]) -> None:
    problem["q_current"] = problem["q_current"][:8]


def spoil_scale(problem: dict[str, Any]) -> None:
    problem["objects"]["articulated"]["scale"] = 0.0


def spoil_clock(problem: dict[str, Any]) -> None:
    problem["actuation_time"] = 18


def spoil_times(problem: dict[str, Any]) -> None:
    problem["post_actuation_times"] = [28]


def spoil_axis(problem: dict[str, Any]) -> None:
    problem["object_axis"] = "w"


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize(
    ("spoil", "field"),
    [
        (spoil_pose, "T_base_object"),
        (spoil_quaternion, "objects.articulated.root_q"),
        (enlarge_pose, "T_base_object"),
        (enlarge_quaternion, "objects.articulated.root_q"),
        (spoil_joints, "q_current"),
        (spoil_scale, "objects.articulated.scale"),
        (spoil_clock, "actuation_time"),
        (spoil_times, "post_actuation_times"),
        (spoil_axis, "object_axis"),
    ],
)
def test_a_bad_value_is_named(parse: Parse, problem: dict[str, Any], spoil: Spoil, field: str) -> None:
    spoil(problem)
    with pytest.raises(InputError, match=rf"line 7: {field}"):
        parse(json.dumps(problem))


@pytest.mark.parametrize("constant", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_numbers_are_finite(parse: Parse, problem: dict[str, Any], constant: str) -> None:
    problem["q_current"][3] = -123.456
    line = json.dumps(problem).replace("-123.456", constant)
    with pytest.raises(InputError, match="line 7"):
        parse(line)


@pytest.mark.parametrize("line", ["{", "[1]", "null", '"x"', "[" * 100_000])
def test_what_is_no_object_is_refused(parse: Parse, line: str) -> None:
    with pytest.raises(InputError, match="line 7"):
        parse(line)


def test_files_are_whole(tmp_path: Path, problem: dict[str, Any]) -> None:
    path = tmp_path / "p.jsonl"
    with pytest.raises(InputError, match="cannot be read"):
        read_problems(path)
    path.write_text("\n\n")
    with pytest.raises(InputError, match="no problems"):
        read_problems(path)
    path.write_text(json.dumps(problem) + "\n\n" + json.dumps(problem) + "\n")
    with pytest.raises(InputError, match=r"line 3: id: the id 'CloseCabinet/0' is already used on line 1"):
        read_problems(path)
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="UTF-8"):
        read_problems(path)


def test_an_axis_frame_that_is_none_reads_as_world(parse: Parse, problem: dict[str, Any]) -> None:
    problem["config"]["constraint_list"][1]["target_axis_frame"] = "frame_axis_parallel"
    parsed = parse(json.dumps(problem))
    assert parsed.odd_frames() == ["frame_axis_parallel"]
    assert parsed.timed_config()["constraint_list"][1]["target_axis_frame"] == "world"


def test_single_precision_poses_become_rotations(parse: Parse, problem: dict[str, Any]) -> None:
    problem["T_base_object"] = np.asarray(problem["T_base_object"], dtype=np.float32).tolist()
    rotation = parse(json.dumps(problem)).pose("T_base_object")[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)

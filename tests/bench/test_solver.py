"""``gensim2 bench solver``: the fields of its output, and plans that pass the independent checker."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gensim2.bench import solve_problems, summary_of
from gensim2.bench.solver import Frames
from gensim2.cli.main import BAD_INPUT, run
from gensim2.core.errors import InputError

pytest.importorskip("mani_skill")

FIELDS = {
    "id",
    "status",
    "reason",
    "warnings",
    "q_actuation",
    "q_best_effort",
    "cost",
    "residuals",
    "q_plan",
    "keyframes",
    "waypoint_times",
    "waypoints",
    "min_clearance_m",
    "start_overlap_m",
    "cpu_ms",
}


@pytest.fixture(scope="module")
def solved(problem_file: Path, assets: Path) -> list[dict[str, Any]]:
    records = solve_problems(problem_file, assets=assets, sample_dt=0.5)
    summary = summary_of(records)
    assert (summary.problems, summary.with_actuation) == (2, 1)
    return records


def test_fields(solved: list[dict[str, Any]]) -> None:
    near, far = solved
    assert set(near) == set(far) == FIELDS | {"sample_dt", "samples"}
    assert [near["id"], far["id"]] == ["CloseCabinet/0", "CloseCabinet/far"]
    assert near["status"] == "solved"
    assert np.asarray(near["waypoints"]).shape == (len(near["waypoint_times"]), 9)
    np.testing.assert_allclose(near["waypoints"][0], [0.0, -0.32, 0.0, -2.61799, 0.0, 2.23, 0.785398, 0.04, 0.04])
    times = [frame["time"] for frame in near["keyframes"]]
    assert times == pytest.approx([16, 20, 24, 28, 32], rel=0.0, abs=1e-9)
    assert set(times) <= set(near["waypoint_times"])
    assert all(np.asarray(frame["T_base_hand"]).shape == (4, 4) for frame in near["keyframes"])
    assert len(near["q_actuation"]) == len(near["q_plan"]) == 9
    assert set(near["min_clearance_m"]) == {"self", "table", "object"}
    assert near["cpu_ms"]["total"] > 0.0
    parts = sum(near["cpu_ms"][part] for part in ("setup", "actuation", "trajectory"))
    assert parts == pytest.approx(near["cpu_ms"]["total"])
    assert len(near["samples"]) == 32 / 0.5 + 1


def test_what_cannot_be_solved_says_so(solved: list[dict[str, Any]]) -> None:
    far = solved[1]
    assert far["status"] == "actuation_infeasible"
    assert far["q_actuation"] is None
    assert far["cost"] is None
    assert len(far["q_best_effort"]) == 9
    assert far["waypoints"] is None
    assert any(not residual["satisfied"] for residual in far["residuals"])
    assert far["reason"]
    assert far["cpu_ms"]["total"] > 0.0


def test_threads_change_nothing_but_the_times(problem_file: Path, assets: Path, solved: list[dict[str, Any]]) -> None:
    for one, two in zip(solved, solve_problems(problem_file, assets=assets, sample_dt=0.5, threads=2), strict=True):
        assert {**one, "cpu_ms": None} == {**two, "cpu_ms": None}


@pytest.mark.usefixtures("peers")
def test_the_checker_finds_nothing(solved: list[dict[str, Any]], problem_file: Path, assets: Path) -> None:
    import check_plans
    import peers

    arm = peers.Arm()
    problems = check_plans.lines(problem_file)
    for problem, record in zip(problems, solved, strict=True):
        finding = check_plans.check_record(problem, record, arm, assets=assets, frames="original")
        assert finding.errors == []


def test_frames_differ_where_the_yaw_turns_a_list_motion(tmp_path: Path, problem: dict[str, Any]) -> None:
    problem["config"]["post_actuation_motions"] = [["translate_x", -0.05], ["translate_z", -0.05]]
    path = tmp_path / "p.jsonl"
    path.write_text(json.dumps(problem) + "\n")
    ends = {}
    choices: tuple[Frames, ...] = ("original", "object")
    for frames in choices:
        record = solve_problems(path, frames=frames)[0]
        frame = {each["time"]: np.asarray(each["T_base_hand"]) for each in record["keyframes"]}
        ends[frames] = frame[24][:3, :3].T @ (frame[28] - frame[24])[:3, 3]
    np.testing.assert_allclose(ends["object"], [-0.05, 0.0, 0.0], atol=1e-9)
    yaw = problem["object_yaw"]
    np.testing.assert_allclose(ends["original"], [-0.05 * np.cos(yaw), -0.05 * np.sin(yaw), 0.0], atol=1e-9)


def test_bad_input(
    tmp_path: Path, problem_file: Path, problem: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    broken = tmp_path / "broken.jsonl"
    broken.write_text(json.dumps(problem) + '\n{"id": NaN}\n')
    out = tmp_path / "out.jsonl"
    assert run(["bench", "solver", "--problems", str(broken), "--json", str(out)]) == BAD_INPUT
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert str(broken) in error
    assert "line 2" in error
    assert not out.exists()
    with pytest.raises(InputError, match="--sample-dt"):
        solve_problems(problem_file, sample_dt=0.0)
    with pytest.raises(InputError, match="articulated_objs"):
        solve_problems(problem_file, assets=tmp_path)
    problem["config"]["constraint_list"][0]["type"] = "glue"
    broken.write_text(json.dumps(problem) + "\n")
    with pytest.raises(InputError, match=r"CloseCabinet/0.*glue"):
        solve_problems(broken)
    assert list(tmp_path.iterdir()) == [broken]


def test_command(problem_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out.jsonl"
    assert run(["bench", "solver", "--problems", str(problem_file), "--json", str(out)]) == 0
    assert "actuation_infeasible 1, solved 1" in capsys.readouterr().out
    assert set(json.loads(out.read_text().splitlines()[0])) == FIELDS

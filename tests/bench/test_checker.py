"""The checker finds errors that were added to a good plan."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gensim2.bench import solve_problems

pytest.importorskip("mani_skill")
pytestmark = pytest.mark.usefixtures("peers")

Spoil = Callable[[dict[str, Any], dict[str, Any]], None]


@pytest.fixture(scope="module")
def good(problem_file: Path, assets: Path) -> dict[str, Any]:
    return solve_problems(problem_file, assets=assets)[0]


def errors_of(problem: dict[str, Any], record: dict[str, Any], assets: Path) -> str:
    import check_plans
    import peers

    finding = check_plans.check_record(problem, record, peers.Arm(), assets=assets, frames="original")
    return "\n".join(finding.errors)


def at(record: dict[str, Any], time: float) -> int:
    """Return the number of the waypoint at a time."""
    (found,) = np.flatnonzero(np.isclose(record["waypoint_times"], time, rtol=0.0, atol=1e-9))
    return int(found)


def shift_waypoint(problem: dict[str, Any], record: dict[str, Any]) -> None:
    index = at(record, 20)
    record["waypoints"][index][1] += 0.01


def leave_a_limit(problem: dict[str, Any], record: dict[str, Any]) -> None:
    record["waypoints"][3][3] = -0.02


def hurry(problem: dict[str, Any], record: dict[str, Any]) -> None:
    times = record["waypoint_times"]
    record["waypoint_times"] = [0.05 * t if t < 16 else t for t in times[:1]] + [
        15.99 + 1e-5 * i if t < 16 else t for i, t in enumerate(times[1:])
    ]


def shift_the_pose(problem: dict[str, Any], record: dict[str, Any]) -> None:
    record["q_actuation"][0] += 0.003


def understate_the_cost(problem: dict[str, Any], record: dict[str, Any]) -> None:
    record["cost"] *= 0.999


def turn_the_pose_out_of_its_axis(problem: dict[str, Any], record: dict[str, Any]) -> None:
    record["q_plan"][5] += 0.03


def claim_another_keyframe(problem: dict[str, Any], record: dict[str, Any]) -> None:
    record["keyframes"][-1]["T_base_hand"][2][3] += 0.01


def claim_to_be_solved(problem: dict[str, Any], record: dict[str, Any]) -> None:
    record["keyframes"][-1]["reached"] = False


def start_elsewhere(problem: dict[str, Any], record: dict[str, Any]) -> None:
    record["waypoints"][0][0] += 1e-3


def forget_a_keyframe(problem: dict[str, Any], record: dict[str, Any]) -> None:
    index = at(record, 28)
    del record["waypoint_times"][index], record["waypoints"][index]


def go_back_in_time(problem: dict[str, Any], record: dict[str, Any]) -> None:
    record["waypoint_times"][2] = record["waypoint_times"][1]


def cut_the_corner(problem: dict[str, Any], record: dict[str, Any]) -> None:
    first, last = at(record, 16), at(record, 20)
    middle = (first + last) // 2
    record["waypoints"][middle][0] += 0.02


def sink_into_the_object(problem: dict[str, Any], record: dict[str, Any]) -> None:
    # The cabinet is in the arm's way instead of beside the goal point.
    problem["objects"]["articulated"]["root_p"][0] -= 0.2


def lie_about_the_id(problem: dict[str, Any], record: dict[str, Any]) -> None:
    record["id"] = "other"


def test_a_good_plan_has_none(problem: dict[str, Any], good: dict[str, Any], assets: Path) -> None:
    assert errors_of(problem, good, assets) == ""


def test_pre_actuation_motions_are_listed_backwards_in_time(problem: dict[str, Any], good: dict[str, Any]) -> None:
    import rules

    problem["config"]["pre_actuation_motions"] = [["translate_z", -0.05], ["translate_x", 0.08]]
    keyframes = rules.expected_keyframes(problem, np.eye(4), "original")
    origins = {frame.time: frame.pose[:3, 3].tolist() for frame in keyframes}
    assert origins[20] == [0.0, 0.0, -0.05]
    assert origins[16] == [0.08, 0.0, -0.05]
    at = {frame["time"]: np.asarray(frame["T_base_hand"]) for frame in good["keyframes"]}
    np.testing.assert_allclose(at[20][:3, 3], at[24][:3, 3] - 0.08 * at[24][:3, 2], atol=1e-9)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (shift_waypoint, "keyframe at 20: missed by"),
        (leave_a_limit, "joint 4 leaves its limits"),
        (hurry, "times the velocity limit"),
        (shift_the_pose, "q_actuation: constraint 0"),
        (understate_the_cost, "cost is"),
        (turn_the_pose_out_of_its_axis, "q_plan: constraint 1"),
        (claim_another_keyframe, "stated pose does not follow"),
        (claim_to_be_solved, "status solved, but"),
        (start_elsewhere, "is not q_current"),
        (forget_a_keyframe, "no waypoint at that time"),
        (go_back_in_time, "times do not increase"),
        (cut_the_corner, "leaves its line"),
        (sink_into_the_object, "mm inside"),
        (lie_about_the_id, "order of the input"),
    ],
)
def test_planted_errors(
    problem: dict[str, Any], good: dict[str, Any], assets: Path, spoil: Spoil, message: str
) -> None:
    record = copy.deepcopy(good)
    spoil(problem, record)
    assert message in errors_of(problem, record, assets)


def test_command(problem: dict[str, Any], good: dict[str, Any], assets: Path, tmp_path: Path) -> None:
    import check_plans

    problems, plans, found = tmp_path / "p.jsonl", tmp_path / "o.jsonl", tmp_path / "f.json"
    problems.write_text(json.dumps(problem) + "\n")
    arguments = ["--problems", str(problems), "--plans", str(plans), "--assets", str(assets), "--json", str(found)]
    plans.write_text(json.dumps(good) + "\n")
    assert check_plans.main(arguments) == 0
    shifted = copy.deepcopy(good)
    shift_waypoint(problem, shifted)
    plans.write_text(json.dumps(shifted) + "\n")
    assert check_plans.main(arguments) == 1
    assert "missed" in json.loads(found.read_text())[0]["errors"][0]
    plans.write_text("")
    assert check_plans.main(arguments) == 1


def test_steps_are_fine(problem: dict[str, Any], good: dict[str, Any]) -> None:
    import judge
    import peers

    arm = peers.Arm()
    times, path = np.asarray(good["waypoint_times"]), np.asarray(good["waypoints"])
    _, fine = judge.refine(arm, times[::10], path[::10])
    placed = judge.corners(arm, fine)
    assert np.linalg.norm(placed[1:] - placed[:-1], axis=2).max() <= judge.STEP

"""Continuous joints count modulo one turn: full turns at the start change nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from constraints import parallel

import gensim2_kpam as kpam

from .kpam_scenes import problem

TURN = 2.0 * np.pi
START = np.array([0.4, 0.5, 0.9, 0.2, 0.6, 0.0])


def endless_arm(tmp_path: Path) -> kpam.Robot:
    """Six joints, of which the first, fourth and last have no limits."""
    links = "".join(f"<link name='l{i}'/>" for i in range(7))
    axes = ["0 0 1", "0 1 0", "0 1 0", "0 0 1", "0 1 0", "0 0 1"]
    at = ["0 0 0.2", "0 0 0.1", "0 0 0.4", "0 0 0.2", "0 0 0.2", "0 0 0.1"]
    joints = "".join(
        f"<joint name='j{i}' type='{'continuous' if i in (0, 3, 5) else 'revolute'}'><parent link='l{i}'/>"
        f"<child link='l{i + 1}'/><origin xyz='{at[i]}'/><axis xyz='{axes[i]}'/>"
        "<limit lower='-2.3' upper='2.3' effort='1' velocity='2'/></joint>"
        for i in range(6)
    )
    file = tmp_path / "endless.urdf"
    file.write_text(f"<robot name='endless'>{links}{joints}</robot>")
    return kpam.Robot.from_urdf(file, hand_link="l6")


def scene(robot: kpam.Robot, start: np.ndarray, goal: np.ndarray, **changes: Any) -> kpam.KeypointProblem:
    point = {"type": "point2point_constraint", "keypoint_name": "tip", "target_keypoint_name": "goal"}
    up = parallel("base", "tip", [0, 0, -1], 0.05)
    settings = {"constraint_list": [{**point, "tolerance": 0.001}, up], "pre_actuation_motions": [["rotate", 0.6]]}
    arguments: dict[str, Any] = {
        "config": settings,
        "q_start": start,
        "tool_keypoints": {"tip": [0, 0, 0.1], "base": [0, 0, 0]},
        "object_keypoints": {"goal": goal},
        "object_axis": "z",
        "bodies": [],
        "options": {"workspace": None},
    }
    return problem(robot, **(arguments | changes))


@pytest.mark.parametrize("turns", [3, 5, -4])
def test_a_wound_start_plans_the_same(tmp_path: Path, turns: int) -> None:
    robot = endless_arm(tmp_path)
    wound = START + turns * TURN * np.array([1, 0, 0, -1, 0, 1])
    draw = np.random.default_rng(0)
    solved = 0
    for _ in range(30):
        goal = np.array([*draw.uniform(-0.5, 0.5, 2), draw.uniform(0.05, 0.4)])
        one, other = (kpam.plan(scene(robot, start, goal)) for start in (START, wound))
        assert one.status == other.status
        if one.trajectory is None or other.trajectory is None or one.cost is None or other.cost is None:
            continue
        solved += one.status == "solved"
        assert abs(one.cost - other.cost) < 1e-6
        assert abs(one.trajectory.duration - other.trajectory.duration) < 1e-3
    assert solved >= 15


def test_motions_go_the_short_way(tmp_path: Path) -> None:
    """From 170 to -170 degrees the motion takes 20 degrees, not 340; and the part before the actuation starts beyond
    that.
    """
    robot = endless_arm(tmp_path)
    start = START.copy()
    start[0] = np.radians(170)
    behind = START.copy()
    behind[0] = np.radians(-170)
    hand = robot.forward_kinematics(behind)
    goal = hand[:3, :3] @ [0, 0, 0.1] + hand[:3, 3]
    point = {"type": "point2point_constraint", "keypoint_name": "tip", "target_keypoint_name": "goal"}
    settings = {"constraint_list": [{**point, "tolerance": 0.001}], "pre_actuation_motions": [["rotate", 3.0]]}
    for motions in ([], [["rotate", 2.5]], [["rotate", -2.5]]):
        plan = kpam.plan(scene(robot, start, goal, config=settings | {"pre_actuation_motions": motions}))
        assert plan.status == "solved", plan.reason
        assert plan.trajectory is not None
        times = [frame["time"] for frame in plan.keyframes]
        first = plan.trajectory.sample(times[0])[0]
        assert (np.abs(first - start)[[0, 3, 5]] <= np.pi + 1e-6).all()
        if not motions:
            assert np.abs(plan.trajectory.positions[:, 0] - start[0]).max() < np.radians(40)

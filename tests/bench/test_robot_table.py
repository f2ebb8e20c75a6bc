"""The benchmark of many robots: a small arm is measured, and the judge finds motions that are wrong."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import robot_table
from robot_judge import Box, RobotModel, Shapes, limit_errors, other_planner

ARM = """<robot name="arm"><link name="base">
<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
{links}
<link name="tip"/><joint name="end" type="fixed"><parent link="l3"/><child link="tip"/>
<origin xyz="0.35 0 0"/></joint></robot>"""
LINK = """<link name="l{k}">
<collision><origin xyz="0.2 0 0"/><geometry><box size="0.3 0.05 0.05"/></geometry></collision>
</link><joint name="j{k}" type="revolute"><parent link="{parent}"/><child link="l{k}"/><origin xyz="{x} 0 0.1"/>
<axis xyz="0 {y} {z}"/><limit lower="-2.5" upper="2.5" velocity="2" effort="9"/></joint>"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a robot of three joints, and the list that names the robot."""
    parents = ("base", "l1", "l2")
    links = [
        LINK.format(k=k + 1, parent=parent, x=0.37 * (k > 0), y=int(k == 1), z=int(k != 1))
        for k, parent in enumerate(parents)
    ]
    (tmp_path / "made").mkdir()
    (tmp_path / "made/arm.urdf").write_text(ARM.format(links="".join(links)))
    listed = '[packages]\nmade = "1"\n[[robots]]\nname = "Arm"\npackage = "made"\nurdf = "arm.urdf"\ntip = "tip"\n'
    (tmp_path / "robots.toml").write_text(listed)
    monkeypatch.setattr(robot_table, "ROBOTS", tmp_path / "robots.toml")
    for name, count in (("POSES", 5), ("PROBLEMS", 3), ("CONFIGURATIONS", 5)):
        monkeypatch.setattr(robot_table, name, count)
    return tmp_path


def test_a_robot_is_measured_and_a_second_run_measures_only_times(folder: Path) -> None:
    out = folder / "robots.json"
    command = ["--robots", str(folder), "--out", str(out)]
    robot_table.main([*command, "--only", "load", "fk", "ik", "plan"])
    row = json.loads(out.read_text())["Arm"]
    assert max(row["fk"].values()) < 1e-12
    assert row["ik"]["solved_16"] == row["ik"]["poses"] == 5
    assert row["ik"]["wrong"] == 0
    solved = [problem for problem in row["plan"]["problems"] if problem["status"] == "solved"]
    assert solved
    assert not any(problem["hulls"] + problem["meshes"] + problem["limits"] for problem in solved)
    robot_table.main([*command, "--only", "plan", "times"])
    again = json.loads(out.read_text())["Arm"]
    assert again["plan"] == row["plan"]
    assert len(again["times"]["cpu_ms"]) == 3
    assert f"| {len(solved)} of 3 drawn | 0 |" in robot_table.table({"Arm": again})


def test_the_judge_finds_collisions_and_exceeded_limits(folder: Path) -> None:
    arm = robot_table.Arm(folder, robot_table.entries([])[0])
    shapes = Shapes(arm.model, arm.checked, hulls=True)
    straight = np.zeros(3)
    wall = Box(np.array([0.05, 0.05, 0.05]), np.eye(4))
    wall.pose[:3, 3] = arm.model.poses(straight)["tip"][:3, 3]
    assert not shapes.collides(straight)
    shapes.place([wall])
    assert shapes.colliding(straight) == {("l3", "box 0")}
    aside = np.array([1.0, 0.0, 0.0])
    assert not shapes.collides(aside)
    away = wall.pose.copy()
    away[0, 3] += 0.054
    shapes.place([Box(wall.half, away)])
    assert not shapes.collides(straight)
    shapes.keep(0.005, [aside])
    assert shapes.collides(straight)
    ramp = np.linspace(0.0, 1.0, 101)[:, None] ** 2
    assert limit_errors(ramp, 0.01, np.zeros(1), np.ones(1), np.full(1, 2.0), 2.0) == []
    assert limit_errors(1.1 * ramp, 0.01, np.zeros(1), np.ones(1), np.full(1, 2.0), 2.0) == [
        "position",
        "velocity",
        "acceleration",
    ]


def test_the_other_planner_finds_a_path_around_a_wall(folder: Path) -> None:
    arm = robot_table.Arm(folder, robot_table.entries([])[0])
    assert isinstance(arm.model, RobotModel)
    shapes, draw = Shapes(arm.model, arm.checked, hulls=True), np.random.default_rng(0)
    wall = Box(np.array([0.05, 0.05, 0.05]), np.eye(4))
    wall.pose[:3, 3] = arm.model.poses(np.zeros(3))["tip"][:3, 3]
    shapes.place([wall])
    start, goal = np.array([-0.6, 0.0, 0.0]), np.array([0.6, 0.0, 0.0])
    tries = iter(range(20_000))
    path = other_planner(shapes, start, goal, lambda: arm.random(draw), lambda: next(tries, None) is None)
    assert path is not None
    assert len(path) > 2
    assert np.array_equal(path[0], start)
    assert np.array_equal(path[-1], goal)
    assert not any(shapes.collides(q) for q in path)

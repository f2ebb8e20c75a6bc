"""A plan that is solved has a motion, from whatever state a robot may truly be in."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gensim2_kpam as kpam

from .kpam_scenes import Q_START, TOOL, problem

Array = np.ndarray

#: Three sliding joints, as of a gantry, and a wrist.
GANTRY = (
    '<robot name="gantry"><link name="base"/>'
    + "".join(
        f'<link name="{name}"><collision><geometry><box size="{size}"/></geometry></collision></link>'
        for name, size in (
            ("x", "0.1 0.1 0.1"),
            ("y", "0.08 0.08 0.08"),
            ("z", "0.05 0.05 0.3"),
            ("hand", "0.06 0.03 0.04"),
        )
    )
    + "".join(
        f'<joint name="{name}" type="prismatic"><parent link="{parent}"/><child link="{name}"/>'
        f'<origin xyz="{origin}"/><axis xyz="{axis}"/>'
        f'<limit lower="{low}" upper="{high}" velocity="0.8" effort="1"/></joint>'
        for name, parent, origin, axis, low, high in (
            ("x", "base", "0 0 1.2", "1 0 0", -0.8, 0.8),
            ("y", "x", "0 0 -0.1", "0 1 0", -0.6, 0.6),
            ("z", "y", "0 0 -0.2", "0 0 1", -0.5, 0.1),
        )
    )
    + '<joint name="turn" type="revolute"><parent link="z"/><child link="hand"/>'
    '<origin xyz="0 0 -0.19" rpy="3.14159265 0 0"/>'
    '<axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="2" effort="1"/></joint></robot>'
)


def point(name: str = "goal", tolerance: float = 1e-3) -> dict[str, Any]:
    return {
        "constraint_list": [
            {
                "type": "point2point_constraint",
                "keypoint_name": "tool_head",
                "target_keypoint_name": name,
                "tolerance": tolerance,
            }
        ]
    }


def moving(robot: kpam.Robot, q: Array, velocity: Array, goal: Array, **options: Any) -> kpam.Plan:
    """The plan to a point from a state in motion, nothing in the way."""
    return kpam.plan(
        problem(
            robot,
            config=point(),
            q_start=q,
            tool_keypoints={"tool_head": TOOL["tool_head"]},
            object_keypoints={"goal": goal},
            joint=None,
            bodies=[],
            options={"start_velocity": velocity, "workspace": None, **options},
        )
    )


def told(plan: kpam.Plan) -> str:
    return f"{plan.status}: {plan.reason}"


def has_motion(plan: kpam.Plan) -> bool:
    """Whether what a plan says of its motion is so."""
    return (plan.status in ("solved", "partial")) == (plan.trajectory is not None)


@pytest.mark.parametrize("rounded", [False, True], ids=["exactly", "in single precision"])
def test_a_start_at_the_velocity_limit(panda: kpam.Robot, rounded: bool) -> None:
    draw = np.random.default_rng(3)
    solved = 0
    for _ in range(400):
        q = Q_START + np.r_[draw.uniform(-0.3, 0.3, 7), 0.0, 0.0]
        velocity = np.zeros(9)
        joint = int(draw.integers(7))
        velocity[:7] = draw.uniform(-0.3, 0.3, 7)
        velocity[joint] = 0.5 * panda.velocity[joint] * draw.choice([-1.0, 1.0])
        if rounded:
            velocity = velocity.astype(np.float32).astype(np.float64)
        plan = moving(panda, q, velocity, draw.uniform([0.35, -0.4, 0.2], [0.65, 0.4, 0.6]))
        assert has_motion(plan), told(plan)
        if plan.trajectory is not None:
            solved += 1
            np.testing.assert_allclose(plan.trajectory.sample(plan.trajectory.times[0])[1], velocity, atol=1e-9)
    assert solved > 300


def test_plans_from_the_samples_of_a_gantrys_own_motion(tmp_path: Any) -> None:
    file = tmp_path / "gantry.urdf"
    file.write_text(GANTRY)
    robot = kpam.Robot.from_urdf(file, hand_link="hand")
    draw = np.random.default_rng(4)
    again = 0
    for _ in range(30):
        q = np.r_[draw.uniform([-0.6, -0.4, -0.3], [0.6, 0.4, 0.0]), 0.3]
        goal = draw.uniform([-0.6, -0.4, 0.2], [0.6, 0.4, 0.6])
        first = moving(robot, q, np.zeros(4), goal)
        assert first.trajectory is not None, told(first)
        for share in np.linspace(0.05, 0.95, 24):
            now = first.trajectory.times[0] + share * first.trajectory.duration
            q_now, velocity, _ = first.trajectory.sample(now)
            plan = moving(robot, q_now, velocity, goal)
            assert has_motion(plan), told(plan)
            again += plan.status == "solved"
    assert again == 30 * 24

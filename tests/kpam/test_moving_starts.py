"""Plans from a moving start: at the velocity limits, from samples of a plan, with acceleration."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from constraints import point_to_point

import gensim2_kpam as kpam

from .kpam_scenes import Q_START, problem

Array = np.ndarray

#: Two prismatic joints over a table, one that lowers the hand, and a wrist, with the URDF's limits.
GANTRY = """
<robot name="gantry">
  <link name="base"/><link name="bridge"/><link name="carriage"/><link name="column"/><link name="hand"/>
  <joint name="x" type="prismatic"><parent link="base"/><child link="bridge"/><axis xyz="1 0 0"/>
    <limit lower="-0.6" upper="0.6" velocity="0.7" effort="1"/></joint>
  <joint name="y" type="prismatic"><parent link="bridge"/><child link="carriage"/><axis xyz="0 1 0"/>
    <limit lower="-0.5" upper="0.5" velocity="0.9" effort="1"/></joint>
  <joint name="z" type="prismatic"><parent link="carriage"/><child link="column"/><axis xyz="0 0 1"/>
    <limit lower="0.1" upper="0.9" velocity="0.3" effort="1"/></joint>
  <joint name="wrist" type="revolute"><parent link="column"/><child link="hand"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" velocity="1.3" effort="1"/></joint>
</robot>
"""


def gantry_problem(robot: kpam.Robot, q: Array, goal: Array) -> kpam.KeypointProblem:
    config = kpam.SolverConfig(
        {
            "constraint_list": [point_to_point("tip", "goal", 0.001)],
            "post_actuation_motions": [["translate_z", 0.1]],
        }
    )
    points = {
        "tool_head": [0.0, 0, 0],
        "tool_tail": [0.0, 0, 0.1],
        "tool_side": [0, 0.1, 0.0],
        "tip": [0.05, 0.02, 0.0],
    }
    options: kpam.Options = {"workspace": None}
    return kpam.KeypointProblem(
        robot,
        config,
        q,
        tool_keypoints=points,
        object_keypoints={"goal": goal},
        T_base_object=np.eye(4),
        options=options,
    )


def assert_continues(before: tuple[Array, ...], plan: kpam.Plan, time: float, free: slice = slice(None)) -> None:
    """Check that a solved plan has a motion that starts in the given state, including its acceleration."""
    assert plan.status == "solved", plan.reason
    assert plan.trajectory is not None
    for name, was, now in zip(("q", "v", "a"), before, plan.trajectory.sample(time), strict=True):
        np.testing.assert_allclose(now[free], was[free], atol=1e-6, err_msg=name)


@pytest.mark.parametrize("single", [False, True])
@pytest.mark.parametrize("scale", [1.0, 0.37])
def test_a_start_at_the_scaled_limit_is_driven(panda: kpam.Robot, single: bool, scale: float) -> None:
    draw = np.random.default_rng(11)
    solved = 0
    for _ in range(40):
        limit = scale * np.append(panda.velocity[:7], [0.0, 0.0])
        velocity = limit * draw.choice([-1.0, 0.0, 1.0], 9, p=[0.2, 0.6, 0.2])
        if single:
            velocity = velocity.astype(np.float32).astype(float)
        options = {"start_velocity": velocity, "velocity_scale": scale}
        plan = kpam.plan(problem(panda, options=options))
        if plan.status != "solved":
            continue
        solved += 1
        assert_continues((Q_START, velocity, np.zeros(9)), plan, 0.0)
        _, v, _ = plan.trajectory.sample(np.linspace(0.0, plan.trajectory.duration, 3000))
        assert (np.abs(v[:, :7]) <= limit[:7] * (1 + 1e-6)).all()
    assert solved >= 20


def test_plans_go_on_from_their_own_samples(tmp_path: Path) -> None:
    file = tmp_path / "gantry.urdf"
    file.write_text(GANTRY)
    robot = kpam.Robot.from_urdf(file, hand_link="hand")
    draw = np.random.default_rng(2)
    again = 0
    for _ in range(60):
        q, goal = (
            draw.uniform([-0.5, -0.4, 0.2, -2], [0.5, 0.4, 0.8, 2]),
            draw.uniform([-0.4, -0.4, 0.2], [0.4, 0.4, 0.7]),
        )
        question = gantry_problem(robot, q, goal)
        plan = kpam.plan(question)
        if plan.status != "solved":
            continue
        for share in draw.uniform(0.05, 0.95, 6):
            assert plan.trajectory is not None
            now = float(share * plan.trajectory.duration)
            state = plan.trajectory.sample(now)
            label = next(f["label"] for f in plan.keyframes if f["time"] is not None and f["time"] > now)
            start = question.with_start(state[0], state[1], now, acceleration=state[2])
            assert_continues(state, kpam.plan(start, warm_start=plan, resume=label), now)
            again += 1
    assert again > 200


def test_with_start_sets_the_whole_state(panda: kpam.Robot) -> None:
    velocity, acceleration = np.zeros(9), np.zeros(9)
    velocity[1], acceleration[1] = 0.3, -2.0
    first = problem(panda, options={"start_velocity": velocity, "start_acceleration": acceleration})
    rested = kpam.plan(first.with_start(Q_START))
    assert_continues((Q_START, np.zeros(9), np.zeros(9)), rested, 0.0)
    moving = kpam.plan(first.with_start(Q_START, velocity, 1.5, acceleration=acceleration))
    assert_continues((Q_START, velocity, acceleration), moving, 1.5)
    with pytest.raises(kpam.ProblemError, match="start_acceleration"):
        first.with_start(Q_START, acceleration=np.zeros(3))


def test_replanning_on_the_way_is_continuous(panda: kpam.Robot) -> None:
    question = problem(panda)
    plan = kpam.plan(question)
    assert plan.trajectory is not None
    for share in np.linspace(0.05, 0.95, 19):
        now = float(share * plan.trajectory.duration)
        state = plan.trajectory.sample(now)
        label = next(f["label"] for f in plan.keyframes if f["time"] is not None and f["time"] > now)
        start = question.with_start(state[0], state[1], now, acceleration=state[2])
        assert_continues(state, kpam.plan(start, warm_start=plan, resume=label), now)

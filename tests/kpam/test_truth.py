"""A solved plan has a motion, from every state that a robot may be in."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from constraints import point_to_point

import gensim2_kpam as kpam

from .kpam_scenes import Q_START, TOOL, problem, table
from .six_arms import gantry

Array = np.ndarray


def point(name: str = "goal", tolerance: float = 1e-3) -> dict[str, Any]:
    return {"constraint_list": [point_to_point("tool_head", name, tolerance)]}


def moving(robot: kpam.Robot, q: Array, velocity: Array, goal: Array, **options: Any) -> kpam.Plan:
    """Return the plan to a point from a moving state, without obstacles."""
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
    """Return whether the plan's statements about its motion are true."""
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
    file.write_text(gantry())
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


def ball(name: str, role: str, place: Array, radius: float) -> kpam.Body:
    pose = np.eye(4)
    pose[:3, 3] = place
    return kpam.Body(name, role, [kpam.Shape.sphere(radius)], pose)  # type: ignore[arg-type]


def test_a_damaged_former_plan_is_not_believed(panda: kpam.Robot) -> None:
    """A former plan whose path was bent between its ends must not lead through the table."""
    low = {"edge": [0.45, 0.3, 0.03], "inside": [0.5, 0.1, 0.05]}
    question = problem(panda, object_keypoints=low, bodies=[])
    former = kpam.plan(question)
    assert former.status == "solved", told(former)
    # The former plan's path is now blocked where the hand passed.
    trajectory = former.trajectory
    assert trajectory is not None
    for share in (0.2, 0.35, 0.5):
        q = trajectory.sample(trajectory.times[0] + share * trajectory.duration)[0]
        hand = panda.forward_kinematics(q)
        thing = ball("thing", "rigid", hand[:3, 3] + 0.11 * hand[:3, 2], 0.012)
        again = kpam.plan(problem(panda, object_keypoints=low, bodies=[thing]), warm_start=former)
        assert has_motion(again), told(again)
        if again.trajectory is not None:
            least = kpam.min_clearance(problem(panda, object_keypoints=low, bodies=[thing]), again, 0.002)
            assert least is not None
            near = min((pair["distance"] for pair in again.tight), default=again.margin)
            assert least["object"] > min(again.margin, near) - 2e-4, (least, told(again))


def test_a_start_inside_a_wall_is_no_start(panda: kpam.Robot) -> None:
    hand = panda.forward_kinematics(Q_START)
    pose = np.eye(4)
    pose[:3, 3] = hand[:3, 3] + [0.05, 0.0, 0.0]
    wall = kpam.Body("wall", "rigid", [kpam.Shape.box([0.03, 0.3, 0.2])], pose)
    plan = kpam.plan(problem(panda, bodies=[table(), wall]))
    assert plan.status == "start_in_collision", told(plan)
    assert plan.trajectory is None
    assert plan.start_overlap > 0.01
    assert "wall" in plan.reason
    assert "wall" in plan.collisions[0]["bodies"]


def test_what_is_nearer_than_the_margin_at_the_goal_is_told(panda: kpam.Robot) -> None:
    """A ball is 2 mm from a finger at the actuation pose: the plan keeps this distance and reports it."""
    free = kpam.plan(problem(panda, bodies=[table()]))
    assert free.q_plan is not None
    assert (free.tight, free.margin) == ([], 0.005)
    tip = panda.forward_kinematics(free.q_plan, "panda_leftfinger") @ [0.0, 0.01, 0.0536, 1.0]
    near = ball("near", "rigid", tip[:3] - [0.0, 0.0, 0.013], 0.01)
    question = problem(panda, bodies=[table(), near])
    plan = kpam.plan(question)
    assert plan.status == "solved", told(plan)
    told_of = [pair for pair in plan.tight if "near" in pair["bodies"]]
    assert "actuation" in {pair["at"] for pair in told_of}, plan.tight
    assert any("near" in warning for warning in plan.warnings)
    found = kpam.min_clearance(question, plan, 0.002)
    assert found is not None
    assert found["object"] > min(pair["distance"] for pair in told_of) - 2e-4


def test_a_contact_has_a_depth(panda: kpam.Robot) -> None:
    """The fingertips reach 1 cm into the lid: more than 3 mm, reported where allowed."""
    pose = np.eye(4)
    pose[:3, 3] = [0.5, 0.1, 0.195]
    lid = kpam.Body("lid", "moving_link", [kpam.Shape.box([0.05, 0.05, 0.012])], pose)
    strict = kpam.plan(problem(panda, bodies=[table(), lid]))
    assert strict.status == "collision", told(strict)
    assert "lid" in strict.reason
    plan = kpam.plan(problem(panda, bodies=[table(), lid], options={"contact_depth": None}))
    assert plan.status == "solved", told(plan)
    free = kpam.plan(problem(panda, bodies=[table(), lid], options={"contact_depth": 0.03}))
    assert free.status == "solved", told(free)
    deepest = max(touch["depth"] for touch in free.touches if "lid" in touch["bodies"])
    assert 0.003 < deepest <= 0.03
    assert [guess["toward"] for guess in free.guesses] == ["post_0", "post_1"]


def test_failures_name_the_workspace_where_it_is_the_reason(panda: kpam.Robot) -> None:
    behind = {"edge": [-0.4, 0.3, 0.4], "inside": [0.5, 0.1, 0.05]}
    config = {**point("edge")}
    boxed = kpam.plan(problem(panda, config=config, object_keypoints=behind))
    assert boxed.status == "actuation_infeasible"
    assert "workspace" in boxed.reason
    assert (
        kpam.plan(problem(panda, config=config, object_keypoints=behind, options={"workspace": None})).status
        == "solved"
    )


def test_the_emitted_curve_keeps_the_margin(panda: kpam.Robot) -> None:
    """The sweep is computed for the final curve in time, which keeps the margin by an independent measurement."""
    turned = Q_START + np.array([1.57] + [0.0] * 8)
    goal = (panda.forward_kinematics(turned) @ [*TOOL["tool_head"], 1.0])[:3]
    place = np.eye(4)
    place[:3, 3] = [0.35, 0.35, 0.4]
    post = kpam.Body("post", "rigid", [kpam.Shape.box([0.03, 0.03, 0.4])], place)
    tool = {"tool_head": TOOL["tool_head"]}
    plan = kpam.plan(
        problem(panda, config=point(), tool_keypoints=tool, object_keypoints={"goal": goal}, joint=None, bodies=[post])
    )
    assert plan.status == "solved", told(plan)
    assert plan.margin == 0.005
    assert plan.trajectory is not None
    samples = plan.trajectory.sample_every(0.002)
    assert float(np.min(kpam.Scene(panda, [post]).distance(samples, 0.1))) >= 0.005 - 2e-4

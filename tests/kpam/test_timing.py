"""Timing: limits, moving starts, and stops only where the gripper acts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import gensim2_kpam as kpam

from .kpam_scenes import Q_START, TOOL, config, problem

VELOCITY, ACCELERATION, JERK = np.full(3, 1.5), np.full(3, 5.0), np.full(3, 400.0)


def speeds(plan: kpam.Plan) -> dict[str, float]:
    """Return the largest joint speed at each keyframe."""
    assert plan.trajectory is not None
    return {frame["label"]: np.abs(plan.trajectory.sample(frame["time"])[1]).max() for frame in plan.keyframes}


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(*[st.floats(-2, 2)] * 3), min_size=2, max_size=7), st.integers(0, 6))
def test_limits_hold_between_samples(waypoints: list[tuple[float, float, float]], stop: int) -> None:
    stop = min(stop, len(waypoints) - 1)
    motion, times = kpam.retime(waypoints, VELOCITY, ACCELERATION, JERK, stops=[stop])
    fine = np.linspace(0.0, motion.duration, 5001)
    q, v, a = motion.sample(fine)
    assert (np.abs(v) <= VELOCITY * (1 + 1e-6)).all()
    assert (np.abs(a) <= ACCELERATION * (1 + 1e-6)).all()
    if motion.duration > 0:
        step = fine[1]
        assert (np.abs(np.diff(a, axis=0)) <= JERK * step * (1 + 1e-6) + 1e-6).all()
        np.testing.assert_allclose(np.diff(q, axis=0) / step, 0.5 * (v[1:] + v[:-1]), atol=JERK[0] * step**2 + 1e-7)
    for k in (0, stop, len(waypoints) - 1):
        there, still, _ = motion.sample(times[k])
        np.testing.assert_allclose(there, waypoints[k], atol=1e-9)
        np.testing.assert_allclose(still, 0.0, atol=1e-9)


def test_samples_come_one_by_one_or_together() -> None:
    motion, times = kpam.retime([[0, 0, 0], [1, 0, 1], [0, 1, 0]], VELOCITY, ACCELERATION, JERK)
    together = motion.sample(times)
    assert [part.shape for part in together] == [(3, 3)] * 3
    for k, time in enumerate(times):
        for part, alone in zip(together, motion.sample(time), strict=True):
            np.testing.assert_array_equal(part[k], alone)
    with pytest.raises(kpam.ProblemError, match="t: "):
        motion.sample(np.nan)


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"stops": [9]}, "stops"),
        ({"slowest": [1.0]}, "slowest"),
        ({"start_velocity": [9.0, 0, 0]}, "start_velocity"),
        ({"start_velocity": [1.0, 0, 0], "position_limits": ([-1, -1, -1], [0.01, 1, 1])}, "start_velocity"),
    ],
)
def test_what_cannot_be_timed_is_named(changes: dict[str, Any], field: str) -> None:
    with pytest.raises(kpam.ProblemError, match=field):
        kpam.retime([[0, 0, 0], [1, 0, 1], [0, 1, 0]], VELOCITY, ACCELERATION, JERK, **changes)


def test_keyframes_are_passed_without_a_stop(panda: kpam.Robot) -> None:
    plan = kpam.plan(problem(panda))
    moving = speeds(plan)
    assert moving["pre_0"] > 0.05
    assert moving["post_1"] < 1e-9
    grasp = kpam.plan(problem(panda, config=config(gripper="grasp")))
    assert speeds(grasp)["actuation"] < 1e-9
    assert speeds(grasp)["pre_0"] > 0.05


def test_contact_has_a_speed_of_its_own(panda: kpam.Robot) -> None:
    plan = kpam.plan(problem(panda, options={"contact_speed": 0.05}))
    assert plan.trajectory is not None
    begin, end = (plan.keyframes[k]["time"] for k in (1, -1))
    times = np.linspace(begin, end, 400)
    hands = panda.forward_kinematics(plan.trajectory.sample(times)[0])
    tips = hands[:, :3, :3] @ TOOL["tool_head"] + hands[:, :3, 3]
    assert (np.linalg.norm(np.diff(tips, axis=0), axis=1) <= 0.052 * (times[1] - times[0])).all()


@pytest.mark.parametrize("speed", [0.2, 0.8])
def test_a_start_under_way_keeps_the_joint_limits(panda: kpam.Robot, speed: float) -> None:
    start = Q_START.copy()
    start[0] = panda.upper[0] - 0.2
    velocity, acceleration = np.zeros(9), np.zeros(9)
    velocity[0], acceleration[0] = speed, 1.0
    options = {"start_velocity": velocity, "start_acceleration": acceleration}
    plan = kpam.plan(problem(panda, q_start=start, options=options))
    assert plan.trajectory is not None, plan.reason
    q, v, _ = plan.trajectory.sample(np.linspace(0.0, plan.trajectory.duration, 2000))
    np.testing.assert_allclose(v[0], velocity, atol=1e-9)
    assert (q[:, :7] <= panda.upper[:7]).all()


@pytest.mark.parametrize("avoid_collisions", [False, True])
def test_a_turn_off_the_line_of_a_start_under_way_keeps_the_joint_limits(
    panda: kpam.Robot, avoid_collisions: bool
) -> None:
    draw = np.random.default_rng(0)
    driven = 0
    for _ in range(300):
        start, velocity = Q_START.copy(), np.zeros(9)
        # Hardly more room than needed to stop, in two joints.
        for joint in (0, 2):
            velocity[joint] = draw.uniform(0.3, 2.0)
            start[joint] = panda.upper[joint] - draw.uniform(0.05, 0.35)
        options = {"start_velocity": velocity, "avoid_collisions": avoid_collisions, "workspace": None}
        plan = kpam.plan(problem(panda, q_start=start, options=options))
        if plan.trajectory is not None:
            driven += 1
            q, _, _ = plan.trajectory.sample(np.linspace(0.0, plan.trajectory.duration, 500))
            assert (q[:, :7] <= panda.upper[:7] + 1e-6).all()
            assert (q[:, :7] >= panda.lower[:7] - 1e-6).all()
    assert driven > 30


@pytest.mark.parametrize(("room", "speed"), [(0.02, 1.0), (2.0, 50.0)])
def test_what_cannot_be_stopped_is_said(panda: kpam.Robot, room: float, speed: float) -> None:
    start = Q_START.copy()
    start[0] = panda.upper[0] - room
    velocity = np.zeros(9)
    velocity[0] = speed
    plan = kpam.plan(problem(panda, q_start=start, options={"start_velocity": velocity}))
    assert plan.status == "cannot_stop"
    assert "panda_joint1" in plan.reason
    assert plan.trajectory is None


def test_a_start_on_its_way_is_not_braked(panda: kpam.Robot) -> None:
    plan = kpam.plan(problem(panda))
    assert plan.trajectory is not None
    middle = 0.5 * plan.keyframes[0]["time"]
    q, v, a = plan.trajectory.sample(middle)
    again = kpam.plan(problem(panda, q_start=q, options={"start_velocity": v, "start_acceleration": a}))
    assert again.status == "solved", again.reason
    assert again.trajectory is not None
    assert again.trajectory.duration < 1.25 * (plan.trajectory.duration - middle)


def test_refinement_is_cheaper_and_keeps_the_keyframes(panda: kpam.Robot) -> None:
    scene = problem(panda)
    plan = kpam.plan(scene)
    found = kpam.refine(scene, plan)
    assert found["cost_after"] < 0.9 * found["cost_before"]
    steps = np.diff(found["waypoints"][:, :7], axis=0) ** 2
    assert (steps @ np.array([10.0, 1, 1, 1, 1, 1, 1])).sum() == pytest.approx(found["cost_after"])
    np.testing.assert_array_equal(found["waypoints"][0], Q_START)
    assert len(found["keyframes"]) == len(plan.keyframes)
    for number, frame in zip(found["keyframes"], plan.keyframes, strict=True):
        hand = panda.forward_kinematics(found["waypoints"][number])
        np.testing.assert_allclose(hand[:3, 3], frame["T_base_hand"][:3, 3], atol=5e-5)
        turn = Rotation.from_matrix(hand[:3, :3] @ frame["T_base_hand"][:3, :3].T).magnitude()
        assert turn <= 0.0301
    kept = kpam.refine(scene, plan, keep_paths=True)
    assert found["cost_after"] <= kept["cost_after"] * 1.001 <= kept["cost_before"] * 1.001

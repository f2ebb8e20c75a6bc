"""Replanning from a moving arm: it arrives in every case, in the shortest time, and the current motion may be kept."""

from __future__ import annotations

import itertools
import time

import numpy as np
import pytest

import gensim2_kpam as kpam

from .kpam_scenes import Q_START, problem

Array = np.ndarray
GOAL = Q_START + np.array([0.9, 0.5, -0.6, 0.7, 0.4, -0.5, 0.8, 0.0, 0.0])


def state(motion: kpam.Trajectory, now: float) -> dict[str, Array | float]:
    _, velocity, acceleration = motion.sample(now)
    return {"start_velocity": velocity, "start_acceleration": acceleration, "start_time": now}


def between(draw: np.random.Generator, count: int) -> list[kpam.Body]:
    """Boxes between the hand's start and its goal."""
    out = []
    for index in range(count):
        pose = np.eye(4)
        pose[:3, 3] = draw.uniform([0.2, -0.1, 0.2], [0.7, 0.7, 0.8])
        out.append(kpam.Body(f"box{index}", "rigid", [kpam.Shape.box(draw.uniform(0.03, 0.09, 3))], pose))
    return out


@pytest.mark.parametrize("rate", [5, 10, 20, 50])
@pytest.mark.parametrize("count", [0, 5])
@pytest.mark.parametrize("knows_motion", [True, False])
def test_replanning_arrives_as_soon_as_the_motion_planned_once(
    panda: kpam.Robot, rate: int, count: int, *, knows_motion: bool
) -> None:
    draw, tried = np.random.default_rng(3), 0
    while tried < 3:
        scene = kpam.Scene(panda, between(draw, count))
        once = scene.plan_to(Q_START, GOAL).trajectory
        if once is None:
            continue
        tried += 1
        motion = once
        for tick in itertools.count(1):
            now = tick / rate
            if now >= motion.times[-1]:
                break
            assert now < 2 * once.duration
            q = motion.sample(now)[0]
            found = scene.plan_to(q, GOAL, **state(motion, now), warm_start=motion if knows_motion else None)
            assert found.trajectory is not None, found.reason
            motion = motion.splice(found.trajectory, now)
        assert motion.times[-1] <= 1.10 * once.duration
        np.testing.assert_allclose(motion.sample(motion.times[-1])[0], GOAL, atol=1e-9)
        rows = [motion.sample(t)[0] for t in np.linspace(0.0, motion.times[-1], 200)]
        assert not kpam.Scene(panda, scene.bodies).in_collision(rows).any()


def test_motions_name_the_limits_that_are_assumed(panda: kpam.Robot) -> None:
    scene = kpam.Scene(panda)
    told = scene.plan_to(Q_START, GOAL).warnings
    assert any("acceleration are assumed (10 rad/s^2 or m/s^2) for panda_joint1" in warning for warning in told)
    assert any("jerk are assumed (5,000 rad/s^3 or m/s^3)" in warning for warning in told)
    assert not any("assumed" in warning for warning in scene.plan_to(Q_START, GOAL, limits="panda").warnings)


def test_keypoint_plans_arrive_at_any_rate(panda: kpam.Robot) -> None:
    question = problem(panda)
    once = kpam.plan(question)
    assert once.trajectory is not None
    for rate in (5, 50):
        motion, former = once.trajectory, once
        for tick in itertools.count(1):
            now = tick / rate
            first = next(f["time"] for f in once.keyframes if f["time"] is not None)
            if now >= min(first, motion.times[-1]):
                break
            q, v, a = motion.sample(now)
            plan = kpam.plan(question.with_start(q, v, now, acceleration=a), warm_start=former)
            assert plan.trajectory is not None, plan.reason
            motion, former = motion.splice(plan.trajectory, now), plan
        assert motion.times[-1] <= 1.10 * once.trajectory.times[-1]


def test_a_motion_under_way_goes_on_unless_something_is_in_its_way(panda: kpam.Robot) -> None:
    draw = np.random.default_rng(8)
    for _ in range(50):
        scene = kpam.Scene(panda, between(draw, 6))
        motion = scene.plan_to(Q_START, GOAL)
        if motion.trajectory is not None and motion.corners is not None and len(motion.corners) > 2:
            break
    once = motion.trajectory
    assert once is not None
    now = 0.3 * once.duration
    q = once.sample(now)[0]
    again = scene.plan_to(q, GOAL, **state(once, now), warm_start=once).trajectory
    assert again is not None
    assert again.times[-1] <= once.times[-1] + 1e-6
    # With a ball on the hand's later path, the current motion is not kept.
    late = panda.forward_kinematics(once.sample(0.7 * once.duration)[0])
    blocked = kpam.Scene(panda, [*scene.bodies, kpam.Body("new", "rigid", [kpam.Shape.sphere(0.04)], late)])
    other = blocked.plan_to(q, GOAL, **state(once, now), warm_start=once)
    if other.trajectory is not None:
        rows = [other.trajectory.sample(t)[0] for t in np.linspace(now, other.trajectory.times[-1], 300)]
        assert not blocked.in_collision(rows).any()


def test_a_start_that_cannot_be_stopped_is_refused(panda: kpam.Robot) -> None:
    q, velocity = Q_START.copy(), np.zeros(9)
    q[0], velocity[0] = panda.upper[0] - 0.01, 2.0
    refused = kpam.Scene(panda).plan_to(q, Q_START, start_velocity=velocity)
    assert (refused.status, refused.trajectory) == ("cannot_stop", None)
    assert "panda_joint1" in refused.reason
    assert f"beyond its upper limit {panda.upper[0]:.4f}" in refused.reason
    with pytest.raises(kpam.ProblemError, match="start_velocity"):
        kpam.Scene(panda).plan_to(Q_START, GOAL, start_velocity=[0.1])


@pytest.mark.parametrize("scale", [1.0, 1e-3])
@pytest.mark.parametrize("deadline_ms", [0.3, 1.0, 3.0, 10.0, 100.0, 1000.0])
def test_deadlines_are_met_at_any_speed(panda: kpam.Robot, scale: float, deadline_ms: float) -> None:
    draw = np.random.default_rng(1)
    scenes = (kpam.Scene(panda, between(draw, 5)) for _ in itertools.count())
    scene = next(scene for scene in scenes if scene.plan_to(Q_START, GOAL).trajectory is not None)
    question = problem(panda, options={"velocity_scale": scale})
    kpam.plan(question)

    def spent(ask: object) -> float:
        begun = time.thread_time()
        assert callable(ask)
        found = ask()
        # Planning runs in its own thread, whose CPU time it reports.
        cpu = found.cpu_ms if isinstance(found.cpu_ms, float) else found.cpu_ms["total"]
        return cpu + 1e3 * (time.thread_time() - begun)

    once = scene.plan_to(Q_START, GOAL, velocity_scale=scale).trajectory
    assert once is not None
    now = 0.3 * once.duration
    q = once.sample(now)[0]
    moving = state(once, now)
    asks = (
        lambda: scene.plan_to(Q_START, GOAL, velocity_scale=scale, deadline_ms=deadline_ms),
        lambda: scene.plan_to(q, GOAL, **moving, velocity_scale=scale, deadline_ms=deadline_ms),
        lambda: kpam.plan(question, deadline_ms=deadline_ms),
    )
    for ask in asks:
        # The best of a few, because the machine may be busy.
        assert min(spent(ask) for _ in range(5)) <= deadline_ms + 1.0

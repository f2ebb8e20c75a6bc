"""Motions in control loops: samples, stops along the path, transitions to another motion; and Ctrl-C."""

from __future__ import annotations

import pickle
import signal
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import gensim2_kpam as kpam

from .kpam_scenes import Q_START

Array = np.ndarray
VELOCITY = np.full(3, 1.5)
LIMITS = [(10.0, 5000.0), (10.0, 300.0), (5.0, 50.0), (2.0, 10.0)]


def motion(acceleration: float, jerk: float, seed: int = 0, **options: Any) -> kpam.Trajectory:
    waypoints = np.cumsum(np.random.default_rng(seed).normal(0, 0.5, (5, 3)), axis=0)
    return kpam.retime(waypoints, VELOCITY, np.full(3, acceleration), np.full(3, jerk), **options)[0]


def assert_within(trajectory: kpam.Trajectory, begin: float, acceleration: float, jerk: float) -> None:
    """Check limits by samples and their differences, and velocities against positions."""
    times = np.linspace(begin, begin + trajectory.duration, 4001)
    q, v, a = trajectory.sample(times)
    step = times[1] - times[0]
    assert (np.abs(v) <= VELOCITY * (1 + 1e-6)).all()
    assert (np.abs(a) <= acceleration * (1 + 1e-6)).all()
    assert (np.abs(np.diff(a, axis=0)) <= jerk * step * (1 + 1e-6) + 1e-7).all()
    np.testing.assert_allclose(np.diff(q, axis=0) / step, 0.5 * (v[1:] + v[:-1]), atol=jerk * step**2 + 1e-7)


@pytest.mark.parametrize(("acceleration", "jerk"), LIMITS)
def test_limits_hold_at_any_jerk(acceleration: float, jerk: float) -> None:
    for seed in range(5):
        assert_within(motion(acceleration, jerk, seed), 0.0, acceleration, jerk)


@pytest.mark.parametrize(("acceleration", "jerk"), LIMITS[1:])
def test_waypoints_are_met_exactly_at_low_jerk(acceleration: float, jerk: float) -> None:
    waypoints = np.cumsum(np.random.default_rng(4).normal(0, 0.5, (6, 3)), axis=0)
    found, times = kpam.retime(waypoints, VELOCITY, np.full(3, acceleration), np.full(3, jerk))
    np.testing.assert_allclose(found.sample(times)[0], waypoints, atol=1e-9)


@pytest.mark.parametrize(("a", "j"), [(10.0, 300.0), (5.0, 50.0), (2.0, 10.0)])
@pytest.mark.parametrize("length", [0.01, 0.3, 4.0])
def test_straight_motions_take_the_known_time(a: float, j: float, length: float) -> None:
    """Closed forms of the S-curve, at most at the limits of velocity and acceleration."""
    v, cube = 1.5, (length / 2 / j) ** (1 / 3)
    if j * cube > a:
        peak = 0.5 * (np.sqrt((a * a / j) ** 2 + 4 * a * length) - a * a / j)
        known = 2 * (peak / a + a / j) if peak < v else length / v + v / a + a / j
    else:
        known = 4 * cube if j * cube**2 < v else length / v + 2 * np.sqrt(v / j)
    found, _ = kpam.retime([[0.0] * 3, [length, -0.5 * length, 0]], VELOCITY, np.full(3, a), np.full(3, j))
    assert found.duration == pytest.approx(known, rel=1e-6)


@pytest.mark.parametrize(("acceleration", "jerk"), LIMITS)
def test_a_stop_keeps_the_limits_and_the_path(acceleration: float, jerk: float) -> None:
    whole = motion(acceleration, jerk)
    path = whole.sample(np.linspace(0, whole.duration, 20001))[0]
    assert whole.brake(0.0).duration == 0.0
    for now in np.linspace(0.02, 0.95, 8) * whole.duration:
        stop = whole.brake(now)
        assert_within(stop, now, acceleration, jerk)
        for was, begins in zip(whole.sample(now), stop.sample(now), strict=True):
            np.testing.assert_allclose(begins, was, atol=1e-9)
        assert now + stop.duration <= whole.duration + 1e-9
        q, v, a = stop.sample(now + stop.duration)
        np.testing.assert_allclose([v, a], 0.0, atol=1e-8)
        assert np.linalg.norm(path - q, axis=1).min() < 2e-4


def test_motions_are_spliced_in_one_state_only() -> None:
    whole = motion(10.0, 5000.0)
    now = 0.4 * whole.duration
    q, v, a = whole.sample(now)
    limits = VELOCITY, np.full(3, 10.0), np.full(3, 5000.0)
    state = {"start_velocity": v, "start_acceleration": a, "start_time": now}
    other, _ = kpam.retime([q, [0.2, 0.1, -0.3]], *limits, **state)
    both = whole.splice(other, now)
    np.testing.assert_array_equal(both.sample(0.5 * now), whole.sample(0.5 * now))
    np.testing.assert_array_equal(both.sample(1.5 * now), other.sample(1.5 * now))
    before, after = both.sample(now - 1e-9), both.sample(now)
    for was, begins in zip(before, after, strict=True):
        np.testing.assert_allclose(was, begins, atol=1e-4)
    np.testing.assert_allclose(after[2], a, atol=1e-6)
    with pytest.raises(kpam.ProblemError, match="next"):
        whole.splice(other, now + 0.02)
    resting, _ = kpam.retime([q, [0.2, 0.1, -0.3]], *limits, start_time=now)
    with pytest.raises(kpam.ProblemError, match="velocity"):
        whole.splice(resting, now)


def test_a_stream_forgets_what_lies_behind_it() -> None:
    limits = VELOCITY, np.full(3, 10.0), np.full(3, 5000.0)
    stream, rng, sizes = motion(10.0, 5000.0), np.random.default_rng(0), []
    for number in range(1, 120):
        now = 0.1 * number
        q, v, a = stream.sample(now)
        state = {"start_velocity": v, "start_acceleration": a, "start_time": now}
        following, _ = kpam.retime([q, rng.uniform(-1.0, 1.0, 3)], *limits, **state)
        kept = stream.splice(following, now)
        stream = kept.since(now - 0.5)
        assert stream.times[0] == now - 0.5 if now > 0.5 else stream.times[0] == 0.0
        np.testing.assert_array_equal(stream.sample(now - 0.05), kept.sample(now - 0.05))
        np.testing.assert_array_equal(stream.sample(now + 0.1), kept.sample(now + 0.1))
        sizes.append(len(pickle.dumps(stream)))
    assert max(sizes[60:]) < 2 * max(sizes[10:20])
    with pytest.raises(kpam.ProblemError, match="not finite"):
        stream.since(float("inf"))


def test_joints_that_neither_motion_moves_have_to_stand_where_they_do(panda: kpam.Robot) -> None:
    scene, other = kpam.Scene(panda), Q_START.copy()
    other[0] += 0.3
    closed = [np.append(q[:7], [0.0, 0.0]) for q in (Q_START, other)]
    opened, closed_motion = scene.plan_to(Q_START, other).trajectory, scene.plan_to(*closed).trajectory
    assert opened is not None
    assert closed_motion is not None
    with pytest.raises(kpam.ProblemError, match="does not move"):
        opened.splice(closed_motion, 0.0)
    np.testing.assert_allclose(opened.splice(opened, 0.0).sample(0.2), opened.sample(0.2))


def test_a_stop_at_the_end_takes_no_time() -> None:
    whole = motion(10.0, 300.0)
    assert whole.brake(whole.duration).duration == 0.0


def test_samples_are_written_in_place() -> None:
    whole = motion(5.0, 50.0)
    rows = np.empty((3, 3))
    for t in np.linspace(-0.1, whole.duration + 0.1, 57):
        whole.sample_into(t, *rows)
        np.testing.assert_array_equal(rows, whole.sample(t))
    with pytest.raises(kpam.ProblemError, match="velocity"):
        whole.sample_into(0.0, rows[0], np.empty(2), rows[2])
    with pytest.raises(kpam.ProblemError, match="contiguous"):
        whole.sample_into(0.0, np.empty(6)[::2], rows[1], rows[2])


def long_retime(count: int) -> Callable[[], object]:
    waypoints = np.cumsum(np.random.default_rng(0).normal(0, 0.5, (count, 7)), axis=0)
    limits = np.full(7, 2.0), np.full(7, 10.0), np.full(7, 5000.0)
    return lambda: kpam.retime(waypoints, *limits)


def large_mesh() -> Callable[[], object]:
    count = 2_000_000
    vertices = np.random.default_rng(0).normal(0, 1, (3000, 3))
    corners = np.arange(3 * count).reshape(-1, 3) * [1, 7, 11] % 3000
    return lambda: kpam.Shape.mesh(vertices, corners)


def then_wait(call: Callable[[], object]) -> None:
    """Call a function, and wait for a signal that comes after it."""
    call()
    time.sleep(2.0)


@pytest.mark.parametrize("work", ["retime", "mesh"])
def test_long_work_answers_ctrl_c(work: str) -> None:
    call = {"retime": lambda: long_retime(100_000), "mesh": large_mesh}[work]()
    sent: list[float] = []

    def interrupt() -> None:
        sent.append(time.process_time())
        identity = threading.main_thread().ident
        assert identity is not None
        signal.pthread_kill(identity, signal.SIGINT)

    timer = threading.Timer(0.3, interrupt)
    timer.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            then_wait(call)
        # CPU time, because a busy machine answers later.
        assert time.process_time() - sent[0] < 1.0
    finally:
        timer.cancel()

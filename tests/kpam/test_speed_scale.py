"""Motions whose speed changes while the robot moves keep their path and the limits of all joints."""

from __future__ import annotations

import numpy as np
import pytest

import gensim2_kpam as kpam
from gensim2.core.seeding import rng

VELOCITY, ACCELERATION = np.array([1.5, 2.0, 1.0]), np.array([8.0, 10.0, 6.0])


@pytest.mark.parametrize("jerk", [60.0, 4000.0])
def test_limits_hold_by_finite_differences(jerk: float) -> None:
    draw = rng(1, "speed_scale", int(jerk))
    slowest = 1.0
    for _ in range(4):
        motion, _ = kpam.retime(draw.uniform(-1.5, 1.5, (5, 3)), VELOCITY, ACCELERATION, [jerk] * 3)
        dt = 0.002
        scaled, target, steps, times = kpam.SpeedScale(motion, dt), 1.0, [], []
        for k in range(20_000):
            if k % 80 == 79:
                target = float(draw.choice([0.0, 1.0, draw.random()])) if k < 3000 else 1.0
            steps.append(scaled.step(target))
            times.append(scaled.time)
            slowest = min(slowest, scaled.scale)
            if scaled.is_finished:
                break
        assert scaled.is_finished
        q, v, a = (np.array(rows) for rows in zip(*steps, strict=True))
        np.testing.assert_allclose(q, motion.sample(np.array(times))[0], atol=1e-9)
        assert (np.abs(v) <= VELOCITY * (1 + 1e-5)).all()
        assert (np.abs(a) <= ACCELERATION * (1 + 1e-5)).all()
        assert (np.abs(np.diff(a, axis=0)) / dt <= jerk * (1 + 1e-5)).all()
        # Limits are checked at the end of each step, so differences of positions exceed them slightly.
        speeds = np.diff(q, axis=0) / dt
        assert (np.abs(speeds) <= VELOCITY * (1 + 1e-3)).all()
        assert (np.abs(np.diff(speeds, axis=0)) / dt <= ACCELERATION * 1.03).all()
    assert slowest == 0.0


def test_wrong_arguments_are_refused() -> None:
    motion, _ = kpam.retime([[0.0], [1.0]], [1.0], [5.0], [100.0])
    with pytest.raises(kpam.ProblemError, match="dt"):
        kpam.SpeedScale(motion, 0.0)
    scaled = kpam.SpeedScale(motion)
    for target in (-0.1, 1.1, float("nan")):
        with pytest.raises(kpam.ProblemError, match="target"):
            scaled.step(target)
    assert (scaled.time, scaled.scale, scaled.is_finished) == (0.0, 1.0, False)

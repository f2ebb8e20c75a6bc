"""The checker of the Franka's commands: it reports each exceeded limit, and nothing otherwise."""

from __future__ import annotations

import numpy as np
import pytest
from franka_arm import TORQUE, VELOCITY, Checker

from gensim2.robots import robot

HOME = np.array(robot("panda").reset_qpos[:7])
NONE = np.zeros(7)


def one(value: float) -> np.ndarray:
    return np.eye(7)[4] * value


@pytest.mark.parametrize(
    ("torque", "last", "q", "v", "error"),
    [
        (one(12.1), one(12.1), HOME, NONE, "tau_j_range_violation"),
        (one(1.1), NONE, HOME, NONE, "controller_torque_discontinuity"),
        (one(np.nan), NONE, HOME, NONE, "controller_torque_discontinuity"),
        (NONE, NONE, HOME, one(-2.7), "joint_velocity_violation"),
        (NONE, NONE, one(2.9), NONE, "joint_position_limits_violation"),
    ],
)
def test_what_passes_a_limit_is_a_reflex(
    torque: np.ndarray, last: np.ndarray, q: np.ndarray, v: np.ndarray, error: str
) -> None:
    found = Checker().reflex(torque, last, q, v)
    assert found is not None
    assert found.error == error


def test_what_is_at_its_limits_is_none_and_shares_are_kept() -> None:
    checker = Checker()
    assert checker.reflex(TORQUE, TORQUE - 1.0, HOME, VELOCITY) is None
    assert checker.largest == pytest.approx({"torque": 1.0, "torque rate": 1.0, "velocity": 1.0})

"""Plans as control actions, on a made-up plan whose joints say which step they belong to."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gensim2.planning.actions import plan_actions
from gensim2.robots import CLOSED, OPEN, robot

PANDA = robot("panda")
CONTROL_HZ, LAG_STEPS, GRIPPER_STEPS = PANDA.control_hz, PANDA.lag_steps, PANDA.gripper_steps
STEPS = 20
ACTUATION = 8


def _plan(steps: int = STEPS) -> Any:
    """Joint 0 counts the control steps; the actuation pose is reached at step ``ACTUATION``."""

    def sample_every(seconds: float) -> Any:
        assert seconds == pytest.approx(1 / CONTROL_HZ)
        return np.column_stack([np.arange(steps), np.full((steps, 8), 0.5)])

    keyframes = [
        {"label": "start", "time": 0.0, "reached": True},
        {"label": "actuation", "time": ACTUATION / CONTROL_HZ, "reached": True},
    ]
    return SimpleNamespace(trajectory=SimpleNamespace(sample_every=sample_every), keyframes=keyframes, reason="")


@pytest.mark.parametrize("gripper", ["open", "closed", "grasp"])
@pytest.mark.parametrize("hold", [0, 4])
def test_every_target_is_sent_and_the_last_one_is_held(gripper: Any, hold: int) -> None:
    actions = plan_actions(_plan(), gripper, PANDA, hold_steps=hold)
    assert actions.dtype == np.float32
    assert actions.shape[1] == 8
    assert np.isfinite(actions).all()
    assert actions[-1, 0] == STEPS - 1
    assert (np.diff(actions[:, 0]) >= 0).all()
    assert np.diff(actions[:, 0]).max() <= LAG_STEPS + 1
    assert len(actions) == len(plan_actions(_plan(), gripper, PANDA, hold_steps=0)) + hold


def test_open_fingers_stay_open_and_targets_are_ahead_by_the_lag() -> None:
    actions = plan_actions(_plan(), "open", PANDA, hold_steps=4)
    assert len(actions) == STEPS + 4
    assert (actions[:, 7] == OPEN).all()
    assert actions[0, 0] == LAG_STEPS
    assert (actions[-4 - LAG_STEPS :, 0] == STEPS - 1).all()


def test_closed_fingers_close_before_the_arm_moves() -> None:
    actions = plan_actions(_plan(), "closed", PANDA)
    assert (actions[:, 7] == CLOSED).all()
    assert (actions[:GRIPPER_STEPS, 0] == 0).all()
    assert actions[GRIPPER_STEPS, 0] == LAG_STEPS


def test_a_grasp_closes_at_the_actuation_pose_and_stays_closed() -> None:
    actions = plan_actions(_plan(), "grasp", PANDA)
    closed = actions[:, 7] == CLOSED
    first = int(closed.argmax())
    assert closed[first:].all()
    assert not closed[:first].any()
    assert (actions[first - LAG_STEPS : first + GRIPPER_STEPS, 0] == ACTUATION).all()
    assert (actions[:first, 0] <= ACTUATION).all()


def test_an_actuation_pose_beyond_the_trajectory_is_its_end() -> None:
    actions = plan_actions(_plan(steps=4), "grasp", PANDA)
    assert actions[-1, 0] == 3
    assert (actions[-1 - GRIPPER_STEPS :, 7] == CLOSED).all()


def test_a_plan_without_a_trajectory_is_refused() -> None:
    with pytest.raises(ValueError, match="no trajectory: out of reach"):
        plan_actions(SimpleNamespace(trajectory=None, reason="out of reach"), "open", PANDA)  # type: ignore[arg-type]

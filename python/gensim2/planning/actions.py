"""A plan as control actions: joint targets and a gripper command at the control frequency."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

import gensim2_kpam as kpam
from gensim2.robots import CLOSED, OPEN, RobotProfile


def plan_actions(
    plan: kpam.Plan, gripper: Literal["open", "closed", "grasp"], robot: RobotProfile, hold_steps: int = 4
) -> npt.NDArray[np.float32]:
    """Return the actions that execute ``plan``.

    Args:
        plan: a plan that has a trajectory.
        gripper: ``"closed"`` closes before the arm moves; ``"grasp"`` closes at the actuation pose.
        robot: who executes it; its drives follow late, so targets are sent ahead by that much.
        hold_steps: steps for which the last target is held, so that the arm arrives.

    Returns:
        (N, m + 1): targets of the m arm joints and the gripper command, 1 open and -1 closed.

    Raises:
        ValueError: the plan has no trajectory.
    """
    trajectory = plan.trajectory
    if trajectory is None:
        raise ValueError(f"the plan has no trajectory: {plan.reason}")
    arm = trajectory.sample_every(1.0 / robot.control_hz)[:, : robot.arm_size]
    split = _actuation_step(plan, robot.control_hz, len(arm)) if gripper == "grasp" else len(arm)
    before, after = _ahead(arm[: split + 1], robot.lag_steps), _ahead(arm[split:], robot.lag_steps)
    approach = CLOSED if gripper == "closed" else OPEN
    parts = []
    if gripper == "closed":
        parts.append(_with_gripper(np.repeat(arm[:1], robot.gripper_steps, axis=0), CLOSED))
    parts.append(_with_gripper(before, approach))
    if gripper == "grasp":
        dwell = np.repeat(arm[split : split + 1], robot.gripper_steps, axis=0)
        parts.append(_with_gripper(dwell[: robot.lag_steps], OPEN))
        parts.append(_with_gripper(dwell, CLOSED))
        parts.append(_with_gripper(after, CLOSED))
        approach = CLOSED
    parts.append(_with_gripper(np.repeat(arm[-1:], hold_steps, axis=0), approach))
    return np.concatenate(parts).astype(np.float32)


def _actuation_step(plan: kpam.Plan, control_hz: int, steps: int) -> int:
    time: float = next(frame["time"] for frame in plan.keyframes if frame["label"] == "actuation")
    return min(round(time * control_hz), steps - 1)


def _ahead(arm: npt.NDArray[np.float64], steps: int) -> npt.NDArray[np.float64]:
    """Shift targets forward by so many steps; the last one is held."""
    if len(arm) == 0:
        return arm
    index = np.minimum(np.arange(len(arm)) + steps, len(arm) - 1)
    return arm[index]


def _with_gripper(arm: npt.NDArray[np.float64], command: float) -> npt.NDArray[np.float64]:
    return np.column_stack([arm, np.full(len(arm), command)])

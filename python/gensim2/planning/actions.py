"""A plan as control actions: joint targets and a gripper command at the control frequency."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

import gensim2_kpam as kpam

#: Control frequency of the environment, Hz.
CONTROL_HZ = 20

#: The joint drives follow their target about this many control steps late, so targets are sent that much ahead.
LAG_STEPS = 2

#: Steps that the gripper is given to open or to close.
GRIPPER_STEPS = 12

GRIPPER_OPEN = 1.0
GRIPPER_CLOSED = -1.0


def plan_actions(
    plan: kpam.Plan, gripper: Literal["open", "closed", "grasp"], hold_steps: int = 4
) -> npt.NDArray[np.float32]:
    """Return the actions that execute ``plan``.

    Args:
        plan: a plan that has a trajectory.
        gripper: ``"closed"`` closes before the arm moves; ``"grasp"`` closes at the actuation pose.
        hold_steps: steps for which the last target is held, so that the arm arrives.

    Returns:
        (N, 8): 7 arm joint targets in rad and the gripper command, 1 open and -1 closed.

    Raises:
        ValueError: the plan has no trajectory.
    """
    trajectory = plan.trajectory
    if trajectory is None:
        raise ValueError(f"the plan has no trajectory: {plan.reason}")
    arm = trajectory.sample_every(1.0 / CONTROL_HZ)[:, :7]
    split = _actuation_step(plan, len(arm)) if gripper == "grasp" else len(arm)
    before, after = _ahead(arm[: split + 1]), _ahead(arm[split:])
    approach = GRIPPER_CLOSED if gripper == "closed" else GRIPPER_OPEN
    parts = []
    if gripper == "closed":
        parts.append(_with_gripper(np.repeat(arm[:1], GRIPPER_STEPS, axis=0), GRIPPER_CLOSED))
    parts.append(_with_gripper(before, approach))
    if gripper == "grasp":
        dwell = np.repeat(arm[split : split + 1], GRIPPER_STEPS, axis=0)
        parts.append(_with_gripper(dwell[:LAG_STEPS], GRIPPER_OPEN))
        parts.append(_with_gripper(dwell, GRIPPER_CLOSED))
        parts.append(_with_gripper(after, GRIPPER_CLOSED))
        approach = GRIPPER_CLOSED
    parts.append(_with_gripper(np.repeat(arm[-1:], hold_steps, axis=0), approach))
    return np.concatenate(parts).astype(np.float32)


def _actuation_step(plan: kpam.Plan, steps: int) -> int:
    time: float = next(frame["time"] for frame in plan.keyframes if frame["label"] == "actuation")
    return min(round(time * CONTROL_HZ), steps - 1)


def _ahead(arm: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Shift targets forward by the lag; the last one is held."""
    if len(arm) == 0:
        return arm
    index = np.minimum(np.arange(len(arm)) + LAG_STEPS, len(arm) - 1)
    return arm[index]


def _with_gripper(arm: npt.NDArray[np.float64], command: float) -> npt.NDArray[np.float64]:
    return np.column_stack([arm, np.full(len(arm), command)])

"""A plan as control actions: joint targets and a gripper command at the control frequency."""

from __future__ import annotations

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


def plan_actions(plan: kpam.Plan, gripper: kpam.Gripper, hold_steps: int = 4) -> npt.NDArray[np.float32]:
    """Return the actions that execute ``plan``.

    Args:
        plan: a plan that has a trajectory.
        gripper: ``"closed"`` closes before the arm moves; ``"grasp"`` closes and ``"release"`` opens at the actuation
            pose; ``"hold"`` stays closed. What holds something lets go of it where the plan says so.
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
    command = GRIPPER_OPEN if gripper in ("open", "grasp") else GRIPPER_CLOSED
    parts = []
    if gripper == "closed":
        parts.append(_with_gripper(np.repeat(arm[:1], GRIPPER_STEPS, axis=0), command))
    begin = 0
    for time, after in _gripper_acts(plan, gripper):
        end = min(round(time * CONTROL_HZ), len(arm) - 1)
        parts.append(_with_gripper(_ahead(arm[begin : end + 1]), command))
        dwell = np.repeat(arm[end : end + 1], GRIPPER_STEPS, axis=0)
        parts.append(_with_gripper(dwell[:LAG_STEPS], command))
        parts.append(_with_gripper(dwell, after))
        begin, command = end, after
    parts.append(_with_gripper(_ahead(arm[begin:]), command))
    parts.append(_with_gripper(np.repeat(arm[-1:], hold_steps, axis=0), command))
    return np.concatenate(parts).astype(np.float32)


def _gripper_acts(plan: kpam.Plan, gripper: kpam.Gripper) -> list[tuple[float, float]]:
    """Times at which the fingers act, in seconds, and the command from then on."""
    frames = plan.keyframes
    labels = [frame["label"] for frame in frames]
    acts = []
    if gripper in ("grasp", "release"):
        command = GRIPPER_CLOSED if gripper == "grasp" else GRIPPER_OPEN
        acts.append((frames[labels.index("actuation")]["time"], command))
    if gripper in ("grasp", "hold") and "let_go" in labels:
        # A plan may end before it.
        time = frames[labels.index("let_go") - 1]["time"]
        acts += [] if time is None else [(time, GRIPPER_OPEN)]
    return acts


def _ahead(arm: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Shift targets forward by the lag; the last one is held."""
    if len(arm) == 0:
        return arm
    index = np.minimum(np.arange(len(arm)) + LAG_STEPS, len(arm) - 1)
    return arm[index]


def _with_gripper(arm: npt.NDArray[np.float64], command: float) -> npt.NDArray[np.float64]:
    return np.column_stack([arm, np.full(len(arm), command)])

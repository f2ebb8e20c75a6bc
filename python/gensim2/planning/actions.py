"""Convert a plan to joint positions, joint velocities and gripper commands at the robot's control rate."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, hypot, pi, tan

import numpy as np
import numpy.typing as npt

import gensim2_kpam as kpam
from gensim2.core.arrays import Array
from gensim2.robots import CLOSED, OPEN, RobotProfile

#: Speed of each finger when closing on a movable object, m/s.
CLOSING_SPEED = 0.06

#: Minimum and maximum grip force of each finger, as multiples of the object's weight. The minimum leaves a reserve for
#: torques and inertia. In some simulators, pads that press harder than the maximum sink into light objects.
LEAST_GRIP_WEIGHTS, MAX_GRIP_WEIGHTS = 6.0, 15.0

#: Safety factor: the friction of both fingers can hold this multiple of the object's weight.
CARRIED_WEIGHTS = 3.0

#: Effective pad radius (m). A pad resists rotation with the friction force times this radius.
PAD_ARM = 0.0075

#: Minimum grip force (N) of each finger. The inertia of the fingers exceeds the inertia of light objects.
LEAST_GRIP_FORCE = 0.5

#: Gravitational acceleration, m/s².
GRAVITY = 9.81

#: Time (s) for which the last position is commanded at the end of a plan, so that the arm settles.
HOLD_SECONDS = 0.2


@dataclass(frozen=True)
class Acts:
    """Gripper commands of a step.

    The arm moves to the actuation pose, where the fingers may act, and then continues.

    Attributes:
        fingers: finger mode of the strategy, such as "grasp" or "release".
        command: gripper command (-1 to 1) until the fingers act at the actuation pose.
        opening: gripper command while the open hand approaches a grasp, -1 to 1.
        grip: gripper command after the fingers have closed, -1 to 1.
        gently: whether the fingers close at ``CLOSING_SPEED``, so that they do not push a movable object.
        before: whether the arm waits first until the fingers have reached ``command``, or moves together with them.
        lets_go: whether the hand opens and retreats at the end of the step.
    """

    fingers: kpam.Gripper
    command: float
    opening: float = OPEN
    grip: float = CLOSED
    gently: bool = False
    before: bool = False
    lets_go: bool = False


@dataclass(frozen=True)
class Schedule:
    """A plan sampled at the control rate, one row for each control step.

    Attributes:
        reference: (N, 2, m) desired joint positions and velocities after each step, without compensation of drive
            errors.
        ends: (N,) index of the last row of the arm's motion for each row; the row's own index if the arm stands still.
        commands: (N,) gripper commands, -1 to 1.
        times: (N,) time on the plan's trajectory that is reached at the end of each step, s.
        contact: first step of the final approach. From this step on, the hand may touch its target.
        actuation: first step at the actuation pose.
        gripped: first step after the fingers have closed on an object; N if they close in the last step. None without a
            grasp.
        released: first step in which the fingers release an object, or None.
    """

    reference: npt.NDArray[np.float32]
    ends: npt.NDArray[np.int64]
    commands: npt.NDArray[np.float32]
    times: Array
    contact: int
    actuation: int
    gripped: int | None
    released: int | None

    def __len__(self) -> int:
        return len(self.commands)


def grip_force(mass: float, margin: float = 0.25 * pi, lever: float = 0.0) -> float:
    """Return the force (N) with which each finger must press to carry an object.

    Args:
        mass: mass of the object, kg.
        margin: angle (rad) from a pad's pressing direction to the edge of the friction cone. For parallel faces it is
            half the cone's opening angle, and less for inclined faces. At zero the pads slip.
        lever: distance (m) of the centre of mass from the line through the pads, about which the weight turns the
            object.
    """
    weights = max(LEAST_GRIP_WEIGHTS, CARRIED_WEIGHTS * hypot(1.0, lever / PAD_ARM) / (2.0 * tan(margin)))
    return max(LEAST_GRIP_FORCE, min(weights, MAX_GRIP_WEIGHTS) * mass * GRAVITY)


def grip_on(pad_distance: float, force: float, profile: RobotProfile, stiffness: float | None = None) -> float:
    """Return the gripper command, -1 to 1, at which each finger presses on an object with the given force.

    If the drive is too soft for this force, the command is the limit of the command range.

    Args:
        pad_distance: distance between the pads, m.
        force: force of each finger, N.
        stiffness: stiffness of the finger drives, N/m; None: the stiffness in the profile.
    """
    command = profile.gripper.grip(pad_distance, force, stiffness or profile.finger_drive.stiffness)
    return float(np.clip(command, CLOSED, OPEN))


def schedule(plan: kpam.Plan, acts: Acts, profile: RobotProfile) -> Schedule:
    """Return the schedule that executes ``plan``.

    Args:
        plan: plan with a trajectory.
        acts: gripper commands.

    Raises:
        ValueError: the plan has no trajectory.
    """
    trajectory = plan.trajectory
    if trajectory is None:
        raise ValueError(f"the plan has no trajectory: {plan.reason}")
    rate = profile.control_hz
    arm = trajectory.sample_every(1.0 / rate)[:, list(profile.arm_columns)]
    reached = {frame["label"]: frame["time"] for frame in plan.keyframes if frame["time"] is not None}

    def step_of(label: str) -> int | None:
        return min(round(reached[label] * rate), len(arm) - 1) if label in reached else None

    last = len(arm) - 1
    actuation = step_of("actuation")
    let_go = step_of(_before_letting_go(plan)) if acts.lets_go else None
    rows = _Rows(arm, profile.arrival_steps, rate, acts.command)
    if acts.before:
        rows.dwell(0, acts.command, profile.gripper_steps)
    at, gripped, released = 0, None, None
    if acts.fingers in ("grasp", "release") and actuation is not None:
        rows.move(at, actuation)
        rows.dwell(actuation, rows.command, rows.settling)
        if acts.fingers == "release":
            released = len(rows)
            rows.dwell(actuation, OPEN, profile.gripper_steps)
        elif acts.gently:
            rows.close(actuation, acts.grip, profile)
            gripped = len(rows)
        else:
            rows.dwell(actuation, acts.grip, profile.gripper_steps)
            gripped = len(rows)
        at = actuation
    if let_go is not None:
        rows.move(at, let_go)
        if acts.fingers in ("grasp", "hold"):
            rows.dwell(let_go, rows.command, rows.settling)
            released = len(rows)
            rows.dwell(let_go, OPEN, profile.gripper_steps)
        at = let_go
    rows.move(at, last)
    rows.dwell(last, rows.command, ceil(HOLD_SECONDS * rate))
    times = rows.times()
    return Schedule(
        rows.reference(),
        np.array(rows.ends),
        np.array(rows.commands, dtype=np.float32),
        times,
        contact=_first(times, (step_of("pre_0") or 0) / rate),
        actuation=len(times) if actuation is None else _first(times, actuation / rate),
        gripped=gripped,
        released=released,
    )


class _Rows:
    """Rows of a schedule under construction.

    Args:
        arm: (K, m) samples of the trajectory at the control rate.
        settling: control steps for the arm to settle after a stop.
        rate: control rate, Hz.
        command: gripper command at the start.
    """

    def __init__(self, arm: Array, settling: int, rate: int, command: float) -> None:
        self._arm, self._rate = arm, rate
        self.settling = settling
        self.command = command
        self.commands: list[float] = []
        self.ends: list[int] = []
        self._steps: list[int] = []

    def __len__(self) -> int:
        return len(self._steps)

    def move(self, start: int, end: int) -> None:
        """Append rows that follow the trajectory from sample ``start`` to sample ``end``."""
        last = len(self) + end - start
        for step in range(start, end + 1):
            self._add(step, last)

    def dwell(self, step: int, command: float, count: int) -> None:
        """Append ``count`` rows in which the arm stays at the trajectory sample ``step``, with one gripper command."""
        self.command = command
        for _ in range(count):
            self._add(step, len(self))

    def close(self, step: int, grip: float, profile: RobotProfile) -> None:
        """Append rows that close the fingers slowly at sample ``step`` and then press with the command ``grip``."""
        travel = profile.gripper.travel(self.command, grip)
        for command in np.linspace(self.command, grip, ceil(travel * self._rate / CLOSING_SPEED) + 1)[1:]:
            self.dwell(step, float(command), 1)
        self.dwell(step, grip, self.settling + ceil(HOLD_SECONDS * self._rate))

    def reference(self) -> npt.NDArray[np.float32]:
        positions = self._arm[self._steps]
        velocities = np.diff(positions, axis=0, prepend=positions[:1]) * self._rate
        return np.stack([positions, velocities], axis=1).astype(np.float32)

    def times(self) -> Array:
        return np.array(self._steps, dtype=np.float64) / self._rate

    def _add(self, step: int, end: int) -> None:
        self._steps.append(step)
        self.ends.append(end)
        self.commands.append(self.command)


def _before_letting_go(plan: kpam.Plan) -> str:
    labels = [frame["label"] for frame in plan.keyframes]
    label: str = labels[labels.index("let_go") - 1]
    return label


def _first(times: Array, time: float) -> int:
    return int(np.searchsorted(times, time - 1e-9))

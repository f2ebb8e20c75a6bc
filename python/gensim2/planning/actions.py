"""A plan as the reference of a robot: arm joints, their velocities and a gripper command at its control frequency."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, hypot, pi, tan

import numpy as np
import numpy.typing as npt

import gensim2_kpam as kpam
from gensim2.robots import CLOSED, OPEN, RobotProfile

Array = npt.NDArray[np.float64]

#: Speed of each finger as it closes on a thing that can be pushed away, m/s.
CLOSING_SPEED = 0.06

#: Weights of what was taken up by which each finger presses: at least, so that its lever and its inertia are carried,
#: too; and at most. In some solvers a contact gives the more, the lighter a body is: pads that are pressed by many
#: times its weight sink into it, and a ball of a few grams is shot out of the fingers.
LEAST_GRIP_WEIGHTS, MAX_GRIP_WEIGHTS = 6.0, 15.0

#: Times its weight that the friction of both fingers is to carry.
CARRIED_WEIGHTS = 3.0

#: Metres from the middle of a pad at which its friction acts against turning about the line between the pads.
PAD_ARM = 0.0075

#: Least force (N) of each finger: what moves the hand moves the fingers, too, and they weigh more than a ball.
LEAST_GRIP_FORCE = 0.5

#: m/s².
GRAVITY = 9.81

#: Seconds for which the last position is held, so that the arm arrives.
HOLD_SECONDS = 0.2


@dataclass(frozen=True)
class Acts:
    """Finger commands along a plan.

    Attributes:
        fingers: as the strategy says.
        command: gripper command, -1 to 1, with which the step begins.
        opening: command at which the hand arrives where it closes, -1 to 1.
        grip: command to which the fingers close, -1 to 1.
        gently: close at ``CLOSING_SPEED``: what is grasped can be pushed away.
        before: whether the command is to be reached before the arm moves.
        lets_go: whether the hand opens and backs off at the end.
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
    """A plan, one row a control step; what drives the arm makes its own commands of it.

    Attributes:
        reference: (N, 2, m) arm joints and velocities that are meant at the end of each step, whatever drives them.
        ends: (N,) row up to which the motion goes that the row is part of; its own where the arm stands.
        commands: (N,) of the gripper, -1 to 1.
        times: (N,) seconds on the plan's clock at which the arm is meant to be when the step ends.
        contact: the first step in which the hand may touch what it reaches for (the way to the actuation pose).
        actuation: the first step at the actuation pose.
        gripped: the first step after the fingers have closed on something, or None; may be N.
        released: the first step in which the fingers let go of something, or None.
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
    """The force (N) of each finger that carries a mass (kg).

    Args:
        margin: angle (rad) that is left between what the fingers press along and the edge of the friction cone: all of
            the cone on parallel faces, next to nothing on faces that slope as much as friction holds.
        lever: distance (m) of the centre of mass from the line between the pads, about which it may turn.
    """
    weights = max(LEAST_GRIP_WEIGHTS, CARRIED_WEIGHTS * hypot(1.0, lever / PAD_ARM) / (2.0 * tan(margin)))
    return max(LEAST_GRIP_FORCE, min(weights, MAX_GRIP_WEIGHTS) * mass * GRAVITY)


def grip_on(pad_distance: float, force: float, profile: RobotProfile, stiffness: float | None = None) -> float:
    """The command, -1 to 1, by which each finger presses with ``force`` (N) on what keeps the pads so far (m) apart.

    Soft drives press as hard as they can where they cannot press so hard.

    Args:
        stiffness: of the fingers' drives, N/m; None takes the profile's.
    """
    command = profile.gripper.grip(pad_distance, force, stiffness or profile.finger_drive.stiffness)
    return float(np.clip(command, CLOSED, OPEN))


def schedule(plan: kpam.Plan, acts: Acts, profile: RobotProfile) -> Schedule:
    """Return the rows that execute ``plan``.

    Args:
        plan: a plan that has a trajectory.
        acts: what the fingers do.
        profile: of the robot that executes them.

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
    """Rows under way.

    Args:
        arm: (K, m) samples of the trajectory at the control frequency.
        settling: control steps that the arm is given to arrive where it stops.
        rate: control frequency, Hz.
        command: of the gripper, at the start.
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
        """Follow the samples from one to another."""
        last = len(self) + end - start
        for step in range(start, end + 1):
            self._add(step, last)

    def dwell(self, step: int, command: float, count: int) -> None:
        """Stay at a sample with a gripper command."""
        self.command = command
        for _ in range(count):
            self._add(step, len(self))

    def close(self, step: int, grip: float, profile: RobotProfile) -> None:
        """Close slowly at a sample to a command, and press."""
        travel = profile.gripper.travel(self.command, grip)
        for command in np.linspace(self.command, grip, ceil(travel * self._rate / CLOSING_SPEED) + 1)[1:]:
            self.dwell(step, float(command), 1)
        self.dwell(step, grip, self.settling + ceil(HOLD_SECONDS * self._rate))

    def reference(self) -> npt.NDArray[np.float32]:
        """(N, 2, m) positions and velocities; where a sample stays, nothing moves."""
        positions = self._arm[self._steps]
        velocities = np.diff(positions, axis=0, prepend=positions[:1]) * self._rate
        return np.stack([positions, velocities], axis=1).astype(np.float32)

    def times(self) -> Array:
        """(N,) seconds on the plan's clock."""
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
    """The first step that ends at or after ``time``."""
    return int(np.searchsorted(times, time - 1e-9))

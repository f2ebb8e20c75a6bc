"""A plan as control actions of a robot: joint targets and a gripper command at its control frequency."""

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
LEAST_GRIP_WEIGHTS, MOST_GRIP_WEIGHTS = 6.0, 15.0

#: Times its weight that the friction of both fingers is to carry.
CARRIED_WEIGHTS = 3.0

#: Metres from the middle of a pad at which its friction acts against turning about the line between the pads.
PAD_ARM = 0.0075

#: Least force (N) of each finger: what moves the hand moves the fingers, too, and they weigh more than a ball.
LEAST_GRIP_FORCE = 0.5

#: m/s².
GRAVITY = 9.81

#: Seconds for which the last target is held, so that the arm arrives.
HOLD_SECONDS = 0.2


@dataclass(frozen=True)
class Acts:
    """What the fingers do along a plan.

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
    """A plan, one row a control step.

    Attributes:
        actions: (N, m + 1) arm joint targets, ahead by the drives' lag, and the gripper command.
        times: (N,) seconds on the plan's clock at which the arm is meant to be when the step ends.
        reference: (N, 2, m) arm joints and velocities that are meant at the end of each step, whatever drives them.
        contact: the first step in which the hand may touch what it reaches for (the way to the actuation pose).
        actuation: the first step at the actuation pose.
        gripped: the first step after the fingers have closed on something, or None; may be N.
        released: the first step in which the fingers let go of something, or None.
    """

    actions: npt.NDArray[np.float32]
    times: Array
    reference: npt.NDArray[np.float32]
    contact: int
    actuation: int
    gripped: int | None
    released: int | None

    def __len__(self) -> int:
        return len(self.actions)


def grip_force(mass: float, margin: float = 0.25 * pi, lever: float = 0.0) -> float:
    """The force (N) of each finger that carries a mass (kg).

    Args:
        margin: angle (rad) that is left between what the fingers press along and the edge of the friction cone: all of
            the cone on parallel faces, next to nothing on faces that slope as much as friction holds.
        lever: distance (m) of the centre of mass from the line between the pads, about which it may turn.
    """
    weights = max(LEAST_GRIP_WEIGHTS, CARRIED_WEIGHTS * hypot(1.0, lever / PAD_ARM) / (2.0 * tan(margin)))
    return max(LEAST_GRIP_FORCE, min(weights, MOST_GRIP_WEIGHTS) * mass * GRAVITY)


def grip_on(pad_distance: float, force: float, profile: RobotProfile, stiffness: float | None = None) -> float:
    """The command, -1 to 1, by which each finger presses with ``force`` (N) on what keeps the pads so far (m) apart.

    Soft drives press as hard as they can where they cannot press so hard.

    Args:
        stiffness: of the fingers' drives, N/m; None takes the profile's.
    """
    command = profile.gripper.grip(pad_distance, force, stiffness or profile.finger_drive.stiffness)
    return float(np.clip(command, CLOSED, OPEN))


def schedule(plan: kpam.Plan, acts: Acts, profile: RobotProfile) -> Schedule:
    """Return the actions that execute ``plan``.

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
    rows = _Rows(arm, profile.lag_steps, rate, acts.command)
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
    actions, times = rows.finish()
    return Schedule(
        actions,
        times,
        rows.reference(),
        contact=_first(times, (step_of("pre_0") or 0) / rate),
        actuation=len(times) if actuation is None else _first(times, actuation / rate),
        gripped=gripped,
        released=released,
    )


class _Rows:
    """Actions under way."""

    def __init__(self, arm: Array, lags: tuple[int, ...], rate: int, command: float) -> None:
        self._arm, self._lags, self._rate = arm, np.array(lags), rate
        self._columns = np.arange(len(lags))
        self.settling = max(lags)
        self.command = command
        self._targets: list[Array] = []
        self._commands: list[float] = []
        self._steps: list[int] = []

    def __len__(self) -> int:
        return len(self._targets)

    def move(self, start: int, end: int) -> None:
        """Follow the samples from one to another, ahead by the lag; the last one is held."""
        for step in range(start, end + 1):
            self._add(self._arm[np.minimum(step + self._lags, end), self._columns], step)

    def dwell(self, step: int, command: float, count: int) -> None:
        """Stay at a sample with a gripper command."""
        self.command = command
        for _ in range(count):
            self._add(self._arm[step], step)

    def close(self, step: int, grip: float, profile: RobotProfile) -> None:
        """Close slowly at a sample to a command, and press."""
        travel = profile.gripper.travel(self.command, grip)
        for command in np.linspace(self.command, grip, ceil(travel * self._rate / CLOSING_SPEED) + 1)[1:]:
            self.dwell(step, float(command), 1)
        self.dwell(step, grip, self.settling + ceil(HOLD_SECONDS * self._rate))

    def reference(self) -> npt.NDArray[np.float32]:
        """(N, 2, m) positions and velocities that the targets are made of; where a sample stays, nothing moves."""
        positions = self._arm[self._steps]
        velocities = np.diff(positions, axis=0, prepend=positions[:1]) * self._rate
        return np.stack([positions, velocities], axis=1).astype(np.float32)

    def _add(self, target: Array, step: int) -> None:
        self._targets.append(target)
        self._commands.append(self.command)
        self._steps.append(step)

    def finish(self) -> tuple[npt.NDArray[np.float32], Array]:
        actions = np.column_stack([np.array(self._targets), np.array(self._commands)]).astype(np.float32)
        return actions, np.array(self._steps, dtype=np.float64) / self._rate


def _before_letting_go(plan: kpam.Plan) -> str:
    labels = [frame["label"] for frame in plan.keyframes]
    label: str = labels[labels.index("let_go") - 1]
    return label


def _first(times: Array, time: float) -> int:
    """The first step that ends at or after ``time``."""
    return int(np.searchsorted(times, time - 1e-9))

"""Convert a keypose program to actions: a planned collision-free motion, then the hand poses of the program."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

import gensim2_kpam as kpam
from gensim2.core.arrays import Array
from gensim2.planning.actions import CLOSING_SPEED, HOLD_SECONDS
from gensim2.policy.keypose.paths import GRAZE, JointPath, joint_path
from gensim2.policy.keypose.program import ACTUATION, APPROACH, KEYPOSES, SAME_COMMAND, KeyposeProgram
from gensim2.policy.keypose.surroundings import Seen, Surroundings
from gensim2.robots import RobotProfile

Row = npt.NDArray[np.float32]

Free = Literal["planned", "but for touched", "table only", "straight"]
"""Obstacles that a free motion avoids: the cloud; the cloud without points that the arm touches at start or goal; only
the table and the robot itself; or nothing.
"""

SHARE = 0.5
"""Fraction of the joint limits that motions use, as in the planner."""
ACCELERATION, JERK = 7.5, 3750.0
"""Limits of joint acceleration and jerk (rad or m per s^2 and s^3) for robots whose profile has no limits: the limits
of the Panda's slowest joint."""
LIMITS = ("limits", "velocity_limits", "acceleration_limits", "jerk_limits")
"""Names of the solver options that limit a robot's joints."""
MARGIN = 0.005
"""Collision margin of free motions, m."""
SAMPLES = 4000


@dataclass(frozen=True)
class Execution:
    """Actions that execute a keypose program.

    Attributes:
        actions: (N, m + 1) targets of the m arm joints and the gripper command, for N control steps.
        free: obstacles that the motion to the first pose of the program avoids.
        reached: number of the program's poses that the actions reach; ``KEYPOSES`` for the complete program.
        contact: index of the first action after the free motion; the program may touch the object from there on.
        gripped: index of the first action after the fingers have opened or closed at the actuation pose.
    """

    actions: Row
    free: Free
    reached: int
    contact: int
    gripped: int

    @property
    def is_whole(self) -> bool:
        """Return whether all poses are reached."""
        return self.reached == KEYPOSES


class Executor:
    """Converts programs to actions for one robot.

    Attributes:
        around: builder of collision scenes from point clouds.
    """

    def __init__(self, profile: RobotProfile) -> None:
        self._profile = profile
        self.around = Surroundings(profile)
        self._arm = list(profile.arm_columns)
        solver: dict[str, Any] = {**profile.solver}
        self._limits = {name: solver[name] for name in LIMITS if name in solver}
        limits = profile.arm_limits(ACCELERATION, JERK)
        self._velocity = SHARE * limits.velocity
        self._acceleration = SHARE * limits.acceleration
        self._jerk = SHARE * limits.jerk

    def execute(
        self,
        program: KeyposeProgram,
        q: Array,
        command: float,
        seen: Seen,
        *,
        further: float = 0.0,
    ) -> Execution | None:
        """Return the actions of a program, or None if the arm cannot reach the actuation pose.

        Args:
            program: program in the base frame.
            q: (n,) present joints, rad or m.
            command: last gripper command, -1 to 1.
            seen: obstacle points and points of the grasped object.
            further: distance (m) by which a push is extended, if the arm can follow the extension.
        """
        q = np.clip(q, self._profile.model.lower, self._profile.model.upper)
        program, path = self._followed(program, q, seen, further)
        if path is None:
            return None
        rows = _Rows(self._profile, command)
        begin = float(program.gripper[0])
        if abs(begin - command) > SAME_COMMAND:
            rows.dwell(q[self._arm], begin, self._profile.gripper_steps)
        rows.command = begin
        free = self._free(rows, q, path.joints[0], seen)
        contact, gripped = len(rows), 0
        for first, last, number in self._segments(program, path):
            rows.follow(self._timed(program, path, first, last))
            rows.act(path.joints[last][self._arm], float(program.gripper[number + 1]), gently=program.force > 0)
            if number == ACTUATION:
                gripped = len(rows)
        rows.dwell(path.joints[-1][self._arm], rows.command, ceil(HOLD_SECONDS * self._profile.control_hz))
        return Execution(rows.actions(), free, path.reached, contact, gripped)

    def _followed(
        self, program: KeyposeProgram, q: Array, seen: Seen, further: float
    ) -> tuple[KeyposeProgram, JointPath | None]:
        """Return the program to execute and its joint path. A push is extended if the arm can follow the extension."""
        depth = self.around.depth_in(seen)
        longer, path = None, None
        if further > 0.0 and program.is_push:
            longer = program.longer(further)
            path = joint_path(longer, q, self.around.bare, depth)
            if path is not None and path.is_whole and path.depth <= GRAZE:
                return longer, path
        own = joint_path(program, q, self.around.bare, depth)
        if longer is None or path is None or not path.is_whole or (own is not None and own.depth < path.depth - GRAZE):
            return program, own
        return longer, path

    def rest(self, q: Array, goal: Array, command: float, seen: Seen) -> Execution:
        """Return the collision-free motion from joints ``q`` to the rest pose ``goal`` (n,)."""
        rows = _Rows(self._profile, command)
        free = self._free(rows, np.clip(q, self._profile.model.lower, self._profile.model.upper), goal, seen)
        rows.dwell(goal[self._arm], command, ceil(HOLD_SECONDS * self._profile.control_hz))
        return Execution(rows.actions(), free, KEYPOSES, len(rows), len(rows))

    def _free(self, rows: _Rows, q: Array, goal: Array, seen: Seen) -> Free:
        q, goal = q.copy(), goal.copy()
        fingers = list(self._profile.gripper_columns)
        # The fingers of an empty hand follow the last command. Fingers that hold an object stay where they are.
        if not seen.holds:
            q[fingers] = self._profile.gripper.at_command(rows.command)
        goal[fingers] = q[fingers]
        for how, scene in self._scenes(q, goal, seen):
            motion = scene.plan_to(
                q,
                goal,
                margin=MARGIN,
                samples=SAMPLES,
                velocity_scale=SHARE,
                acceleration_scale=SHARE,
                **self._limits,
            )
            if motion.trajectory is not None:
                rows.follow(motion.trajectory.sample_every(1.0 / self._profile.control_hz)[:, self._arm])
                return how
        rows.follow(self._retimed(np.linspace(q, goal, 8)[:, self._arm]))
        return "straight"

    def _scenes(self, q: Array, goal: Array, seen: Seen) -> Iterator[tuple[Free, kpam.Scene]]:
        """Yield collision scenes with fewer and fewer obstacles; the caller uses the first scene in which planning
        succeeds.
        """
        yield "planned", self.around.scene(seen)
        untouched = self.around.untouched(seen, q, goal)
        if len(untouched.standing) < len(seen.standing):
            yield "but for touched", self.around.scene(untouched)
        if len(seen.standing) or len(seen.held):
            yield "table only", self.around.bare

    def _segments(self, program: KeyposeProgram, path: JointPath) -> list[tuple[int, int, int]]:
        """Return three indices for each segment between two stops of the arm: the index of the segment's first
        waypoint, of its last waypoint, and of the program's pose at its end.

        The arm stops at the actuation pose, at poses where the fingers move, before the retreat, and at the end.
        """
        reached = [number for number in range(KEYPOSES) if path.at[number] >= 0]
        rests = {ACTUATION, KEYPOSES - 2, reached[-1]}
        rests |= {n for n in reached if abs(float(program.gripper[n + 1] - program.gripper[n])) > SAME_COMMAND}
        found, first = [], 0
        for number in reached:
            if number in rests and number != APPROACH:
                found.append((first, int(path.at[number]), number))
                first = int(path.at[number])
        return found

    def _timed(self, program: KeyposeProgram, path: JointPath, first: int, last: int) -> Array:
        """Return samples (N, m) of a segment, which is executed no faster than the program's times allow."""
        slowest = np.zeros(len(path.joints) - 1)
        for number in range(1, KEYPOSES):
            begin, end = path.at[number - 1], path.at[number]
            if 0 <= begin < end:
                slowest[begin:end] = program.seconds[number] / (end - begin)
        return self._retimed(path.joints[first : last + 1, self._arm], slowest[first:last])

    def _retimed(self, waypoints: Array, slowest: Array | None = None) -> Array:
        apart = np.concatenate([[True], np.abs(np.diff(waypoints, axis=0)).max(axis=1) > 1e-6])
        if slowest is not None:
            slowest = np.array([part.sum() for part in np.split(slowest, np.flatnonzero(apart[1:]))])[: apart.sum() - 1]
        waypoints = waypoints[apart]
        if len(waypoints) < 2:
            return waypoints
        motion, _ = kpam.retime(waypoints, self._velocity, self._acceleration, self._jerk, slowest=slowest)
        return motion.sample_every(1.0 / self._profile.control_hz)


class _Rows:
    def __init__(self, profile: RobotProfile, command: float) -> None:
        self._profile, self.command = profile, command
        self._positions: list[Array] = []
        self._ends: list[int] = []
        self._commands: list[float] = []

    def __len__(self) -> int:
        return len(self._positions)

    def follow(self, samples: Array) -> None:
        """Append joint samples (N, m), one for each control step."""
        last = len(self) + len(samples) - 1
        for sample in samples:
            self._add(sample, last)

    def dwell(self, target: Array, command: float, count: int) -> None:
        """Keep the arm at joints (m,) with a gripper command for ``count`` control steps."""
        self.command = command
        for _ in range(count):
            self._add(target, len(self))

    def act(self, target: Array, command: float, gently: bool) -> None:
        """Wait until the arm has reached the joint positions ``target`` (m,), then give the fingers a new command.

        Nothing happens if the command of the fingers does not change. If ``gently`` is true, the fingers close slowly.
        """
        before, rate = self.command, self._profile.control_hz
        if abs(command - before) <= SAME_COMMAND:
            return
        self.dwell(target, before, self._profile.arrival_steps)
        if gently and command < before:
            steps = ceil(self._profile.gripper.travel(before, command) * rate / CLOSING_SPEED) + 1
            for each in np.linspace(before, command, steps)[1:]:
                self.dwell(target, float(each), 1)
            self.dwell(target, command, self._profile.arrival_steps + ceil(HOLD_SECONDS * rate))
        else:
            self.dwell(target, command, self._profile.gripper_steps)

    def actions(self) -> Row:
        """Return the actions (N, m + 1): gripper commands, and arm targets that compensate tracking delays."""
        positions = np.array(self._positions, dtype=np.float32)
        targets = self._profile.simulated_targets(positions, np.array(self._ends))
        return np.column_stack([targets, self._commands]).astype(np.float32)

    def _add(self, position: Array, end: int) -> None:
        self._positions.append(position)
        self._ends.append(end)
        self._commands.append(self.command)

"""Define the limits of an arm's commands, including collision geometry."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

import gensim2_kpam as kpam
from gensim2.core.arrays import Array
from gensim2.core.errors import InputError
from gensim2.robots import RobotProfile
from gensim2.robots.force import FORCE_LIMIT


@dataclass(frozen=True, eq=False)
class Braking:
    """Velocity limits that depend on the joint position.

    Velocity limits near the ends of the joint ranges.

    The limits are ``-offset + sqrt(gain (upper - q))`` upwards and ``-offset + sqrt(gain (q - lower))`` downwards, and
    0 at least.

    Attributes:
        upper, lower: (m,) positions at which the square root is 0, rad.
        gain: (m,) rad/s^2, twice the allowed deceleration.
        offset: (m,) offset of the velocity limit, rad/s.
    """

    upper: Array
    lower: Array
    gain: Array
    offset: Array

    def scaled(self, share: float) -> Braking:
        """Return a copy whose velocity limits are multiplied by ``share`` at every position."""
        return replace(self, gain=share**2 * self.gain, offset=share * self.offset)

    def fastest(self, q: Array) -> tuple[Array, Array]:
        """Return the maximum upward and downward velocities (..., m), rad/s, at joint positions ``q`` (..., m), rad."""
        return self._root(self.upper - q), self._root(q - self.lower)

    def ahead(self, seconds: float) -> Braking:
        """Return limits with which a joint respects the original limits ``seconds`` later.

        A joint with the velocity v comes closer to its end by ``v * seconds``. With the distance ``room``, the limit
        therefore solves ``v = -offset + sqrt(gain (room - v seconds))``. The solution has the same form, with larger
        ``offset`` and ``upper`` and smaller ``lower``.
        """
        offset = self.offset + 0.5 * self.gain * seconds
        room = (offset**2 - self.offset**2) / self.gain
        return Braking(self.upper + room, self.lower - room, self.gain, offset)

    def range(self) -> tuple[Array, Array]:
        """Return the lowest and highest useful position (m,) of each joint, rad.

        There, the limit is ``0.1 * offset``.
        """
        room = (1.1 * self.offset) ** 2 / self.gain
        return self.lower + room, self.upper - room

    def rows(self) -> list[tuple[float, float, float, float]]:
        """Return upper, lower, gain and offset of each joint, in the form that ``gensim2_kpam.retime`` takes."""
        columns = (self.upper, self.lower, self.gain, self.offset)
        return [(float(u), float(low), float(k), float(o)) for u, low, k, o in zip(*columns, strict=True)]

    def _root(self, room: Array) -> Array:
        found: Array = np.maximum(np.sqrt(np.maximum(self.gain * room, 0.0)) - self.offset, 0.0)
        return found


FR3 = Braking(
    upper=np.array([2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196]),
    lower=np.array([-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196]),
    gain=np.array([12.0, 5.17, 7.0, 8.0, 34.0, 11.0, 34.0]),
    offset=np.array([0.3, 0.2, 0.2, 0.3, 0.35, 0.35, 0.35]),
)
"""Franka's published limits of the Research 3, as in the solver (``limits: "fr3"``)."""


CYCLE = 0.01
"""Time between two commands, s."""

SPEED = 0.1
"""Default fraction of the arm's maximum speed."""
MARGIN = 0.1
"""Default minimum distance (rad or m) of joints from the ends of their range."""
TOOL_SPEED = 1.7
"""Maximum tool speed (m/s) at full arm speed: the limit of the Panda, which is the lowest of all supported arms."""

JUMP = 0.2
"""Default maximum distance (rad or m) of an episode's first action from the arm's position."""
LEASH = 0.04
"""Maximum distance (rad or m) of a target from an arm at rest. In motion, the delay of the drives is added."""
YIELDING = 0.5
"""Fraction of the force limit at which an arm no longer presses: its targets are then its measured position."""

_PANDA = np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]), np.array([7500.0, 3750, 5000, 6250, 7500, 10000, 10000])
"""Franka's published acceleration (rad/s^2) and jerk (rad/s^3)."""
_UNKNOWN = 10.0, 5000.0
"""Acceleration and jerk of joints without published limits, as in the solver."""

_TABLE_SIDE, _TABLE_DEPTH = 2.4, 0.06


@dataclass(frozen=True, eq=False)
class ArmLimits:
    """Limits of every command to an arm.

    Velocity limits are a fraction of the arm's maximum. Acceleration and jerk are the arm's maximum, for fast stops.

    Attributes:
        lower, upper: (m,) position limits of the arm's joints, rad or m; they lie inside the joint ranges by a margin.
        range_lower, range_upper: (m,) ends of the joint ranges, rad or m.
        velocity, acceleration, jerk: (m,) maximum values, in rad or m per s, s^2 and s^3.
        braking: additional velocity limits that depend on the position; None if the arm has none.
        tool_speed: maximum speed of the tool, m/s.
        low, high: (3,) corners of the tool's workspace in the robot's base frame, m.
        clearance: minimum distance between links of the robot, and between the robot and the table, m.
        force: maximum contact force on the arm, N.
        leash: maximum distance (rad or m) between a target and the measured position of a joint. The limit keeps the
            force small if an obstacle blocks the arm. A measured contact force reduces the distance further.
        jump: maximum distance (rad or m) of the first target of an episode from the arm, and of any target beyond the
            joint range.
    """

    profile: RobotProfile
    lower: Array
    upper: Array
    range_lower: Array
    range_upper: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    tool_speed: float
    low: Array
    high: Array
    clearance: float
    force: float
    leash: float
    jump: float
    braking: Braking | None = None

    @staticmethod
    def of(
        profile: RobotProfile,
        *,
        speed: float = SPEED,
        margin: float = MARGIN,
        low: tuple[float, float, float] = (-0.3, -0.9, 0.0),
        high: tuple[float, float, float] = (0.95, 0.9, 1.25),
        clearance: float = 0.005,
        force: float = FORCE_LIMIT,
        jump: float = JUMP,
    ) -> ArmLimits:
        """Return the limits of a robot.

        Args:
            speed: fraction of the robot's maximum speed, above 0 and at most 1.
            margin: minimum distance (rad or m) of joints from the ends of their range.
            low, high, clearance, force, jump: as in :class:`ArmLimits`.

        Raises:
            InputError: a number is invalid.
        """
        if not 0.0 < speed <= 1.0:
            raise InputError(f"must be above 0 and at most 1, but is {speed}", field="speed")
        for name, value in (("margin", margin), ("clearance", clearance)):
            if not (np.isfinite(value) and value >= 0.0):
                raise InputError(f"must be a number and at least 0, but is {value}", field=name)
        for name, value in (("force", force), ("jump", jump)):
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"must be a positive number, but is {value}", field=name)
        columns, model = list(profile.arm_columns), profile.model
        range_lower, range_upper = model.lower[columns], model.upper[columns]
        lower, upper = range_lower + margin, range_upper - margin
        braking = FR3.scaled(speed) if profile.solver.get("limits") == "fr3" else None
        # The FR3 is very slow near the ends of a joint range. Therefore these positions are excluded.
        if braking is not None:
            lowest, highest = braking.range()
            lower, upper = np.maximum(lower, lowest), np.minimum(upper, highest)
        if (lower >= upper).any():
            raise InputError("must be smaller, because with this margin a joint of the arm cannot move", field="margin")
        own = profile.arm_limits(*(_PANDA if profile.solver.get("limits") == "panda" else _UNKNOWN))
        if not np.isfinite(own.velocity).all():
            wrong = "a joint of the arm has no velocity limit"
            raise InputError(wrong, file=profile.urdf, field="limit", remedy="add <limit velocity=...>")
        return ArmLimits(
            profile,
            lower,
            upper,
            range_lower,
            range_upper,
            speed * own.velocity,
            own.acceleration,
            own.jerk,
            speed * TOOL_SPEED,
            np.array(low),
            np.array(high),
            clearance,
            force,
            LEASH,
            jump,
            braking,
        )

    def leash_under(self, force: float, v: Array) -> Array:
        """Return the maximum distance (m,) of each joint's target from its position, rad or m.

        The distance shrinks with the force, and is 0 if the force is at least ``YIELDING`` times the limit.

        Args:
            force: contact force, N.
            v: (m,) measured velocity, rad/s or m/s.
        """
        return (self.leash + self.profile.lags * np.abs(v)) * max(0.0, 1.0 - force / (YIELDING * self.force))

    def fastest_from(self, q: Array) -> tuple[Array, Array]:
        """Return the maximum upward and downward velocities (m,), both positive, of a command at joints ``q`` (m,)."""
        if self.braking is None:
            return self.velocity, self.velocity
        up, down = self.braking.ahead(CYCLE).fastest(q)
        return np.minimum(up, self.velocity), np.minimum(down, self.velocity)

    def brakes(self, q: Array, v: Array, slack: float) -> bool:
        """Return whether commands respect the velocity limits of ``braking``.

        Args:
            q, v: (N, m) or (m,) positions and velocities of the commands.
            slack: tolerance of velocities for rounding, as a fraction of the limit, plus rad/s.
        """
        if self.braking is None:
            return True
        up, down = self.braking.fastest(q)
        return bool((v <= (1.0 + slack) * up + slack).all() and (-v <= (1.0 + slack) * down + slack).all())

    @property
    def size(self) -> int:
        """Number of joints of the arm, m."""
        return len(self.lower)

    def prepare(self) -> None:
        """Build the collision scene and caches in advance, so that they do not delay the first command."""
        here = self._open[None, list(self.profile.arm_columns)]
        self.tool(here)
        self.is_clear(here)

    @cached_property
    def scene(self) -> kpam.Scene:
        """Collision scene with the robot and its table."""
        pose = np.eye(4)
        pose[:3, 3] = [0.0, 0.0, -0.5 * _TABLE_DEPTH]
        sides = [_TABLE_SIDE, _TABLE_SIDE, 0.5 * _TABLE_DEPTH]
        table = kpam.Body("table", "table", [kpam.Shape.box(sides)], pose)
        return kpam.Scene(self.profile.model, [table])

    @cached_property
    def _open(self) -> Array:
        """Start positions of all active joints (n,), but with open fingers."""
        joints = np.array(self.profile.reset_qpos, dtype=np.float64)
        joints[list(self.profile.gripper_columns)] = self.profile.gripper.at_command(1.0)
        return joints

    def whole(self, arm: Array) -> Array:
        """Return all joints (N, n) for arm positions (N, m). The fingers are open, which needs the most space."""
        rows = np.tile(self._open, (len(arm), 1))
        rows[:, list(self.profile.arm_columns)] = arm
        return rows

    def tool(self, arm: Array) -> Array:
        """Return the tool positions (N, 3), m in the base frame, at arm joints (N, m)."""
        return np.asarray(self.profile.model.forward_kinematics(self.whole(arm), self.profile.tool_link)[:, :3, 3])

    def is_clear(self, arm: Array) -> bool:
        """Return whether all N joint configurations (N, m) keep the clearance between the links and from the table."""
        distance = np.asarray(self.scene.distance(self.whole(arm), 2.0 * self.clearance + 1e-3))
        return bool((distance >= self.clearance).all())

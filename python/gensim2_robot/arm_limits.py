"""Limits of an arm: numbers, and the shapes that it must not come near."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

import gensim2_kpam as kpam
from gensim2.core.errors import InputError
from gensim2.robots import RobotProfile

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Braking:
    """Velocity limits ``-offset + sqrt(gain (upper - q))`` upwards, ``-offset + sqrt(gain (q - lower))`` downwards.

    Beside constant limits; 0 where they would be negative.

    Attributes:
        upper, lower: (m,) rad, where the limits would be ``-offset``.
        gain: (m,) rad/s^2, twice the deceleration that they allow for.
        offset: (m,) rad/s.
    """

    upper: Array
    lower: Array
    gain: Array
    offset: Array

    def scaled(self, share: float) -> Braking:
        """Limits that are a share of these everywhere."""
        return replace(self, gain=share**2 * self.gain, offset=share * self.offset)

    def fastest(self, q: Array) -> tuple[Array, Array]:
        """(..., m) rad/s upwards and downwards, each at least 0, at (..., m) positions (rad)."""
        return self._root(self.upper - q), self._root(q - self.lower)

    def ahead(self, seconds: float) -> Braking:
        """Limits that a joint keeps for so long as it goes on at its velocity.

        ``v = -offset + sqrt(gain (room - v seconds))``, solved for v, is such a limit itself.
        """
        offset = self.offset + 0.5 * self.gain * seconds
        room = (offset**2 - self.offset**2) / self.gain
        return Braking(self.upper + room, self.lower - room, self.gain, offset)

    def range(self) -> tuple[Array, Array]:
        """(m,) lower and upper positions (rad) at which a joint may still come nearer, by a tenth of the offset."""
        room = (1.1 * self.offset) ** 2 / self.gain
        return self.lower + room, self.upper - room

    def rows(self) -> list[tuple[float, float, float, float]]:
        """Upper, lower, gain and offset of each joint, as ``gensim2_kpam.retime`` takes them."""
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
"""As Franka publishes them for the Research 3; the solver has the same (``limits: "fr3"``)."""


CYCLE = 0.01
"""Seconds from one command on the wire to the next."""

SPEED = 0.1
"""Share of the arm's speed where nothing else is said."""
MARGIN = 0.1
"""Rad (m) that joints keep from the ends of their range where nothing else is said."""
TOOL_SPEED = 1.7
"""Metres a second that the tool makes at most at full speed: the Panda's, the slowest of the arms that are known."""

FORCE = 140.0
"""Newtons that may press on the arm where nothing else is said: ISO/TS 15066 has them for a hand that is clamped."""

JUMP = 0.2
"""Rad (m) by which the first action of an episode may lie off where the arm stands."""
LEASH, LEASH_AT_SPEED = 0.08, 0.2
"""Rad (m) by which a target may lead the measured arm: standing, and what a drive trails by at full speed beside it."""

_PANDA = np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]), np.array([7500.0, 3750, 5000, 6250, 7500, 10000, 10000])
"""Acceleration (rad/s^2) and jerk (rad/s^3) as Franka publishes them."""
_UNKNOWN = 10.0, 5000.0
"""The same of a joint that nothing is known of, as in the solver; Franka publishes them for the Research 3."""

_TABLE_SIDE, _TABLE_DEPTH = 2.4, 0.06


@dataclass(frozen=True, eq=False)
class ArmLimits:
    """Limits that no command passes.

    Speed is a share of the arm's; accelerations and jerks are the arm's own at any speed, so that it stops as fast as
    it can.

    Attributes:
        profile: of the robot.
        lower, upper: (m,) positions of the arm's joints, rad or m, the margin taken off.
        range_lower, range_upper: (m,) the ends of their range.
        velocity, acceleration, jerk: (m,) a second, a second squared and cubed.
        braking: velocity limits that depend on the position, beside ``velocity``; None: there are none.
        tool_speed: of the tool, m/s.
        low, high: (3,) corners of the workspace of the tool in the robot's base frame, m.
        clearance: that the robot keeps from itself and from the table, m.
        force: that presses on the arm from outside, N.
        leash: rad (m) by which a target may lead the measured arm: what is blocked is pressed on no harder. A force
            shortens it.
        jump: rad (m) by which the first target of an episode may lie off where the arm stands, and by which any may lie
            outside the range of a joint.
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
        force: float = FORCE,
        jump: float = JUMP,
    ) -> ArmLimits:
        """Limits of a robot.

        Args:
            speed: share of its speed, above 0 to 1.
            margin: rad (m) that joints keep from the ends of their range.
            low, high, clearance, force, jump: see the class.

        Raises:
            InputError: a number is none that limits anything.
        """
        if not 0.0 < speed <= 1.0:
            raise InputError(f"must be above 0 and at most 1, is {speed}", field="speed")
        for name, value in (("margin", margin), ("clearance", clearance)):
            if not (np.isfinite(value) and value >= 0.0):
                raise InputError(f"must be a number of at least 0, is {value}", field=name)
        for name, value in (("force", force), ("jump", jump)):
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"must be a positive number, is {value}", field=name)
        columns, model = list(profile.arm_columns), profile.model
        range_lower, range_upper = model.lower[columns], model.upper[columns]
        lower, upper = range_lower + margin, range_upper - margin
        braking = FR3.scaled(speed) if profile.solver.get("limits") == "fr3" else None
        if braking is not None:  # which no joint reaches the ends of
            lowest, highest = braking.range()
            lower, upper = np.maximum(lower, lowest), np.minimum(upper, highest)
        if (lower >= upper).any():
            raise InputError("leaves a joint no range", field="margin")
        own = profile.arm_limits(*(_PANDA if profile.solver.get("limits") == "panda" else _UNKNOWN))
        if not np.isfinite(own.velocity).all():
            raise InputError("a joint of the arm has no velocity limit", file=profile.urdf, field="limit")
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
            LEASH + speed * LEASH_AT_SPEED,
            jump,
            braking,
        )

    def leash_under(self, force: float) -> float:
        """Leash (rad or m) under a force (N), by the share that is left of what may press on the arm."""
        return self.leash * (1.0 - force / self.force)

    def fastest_from(self, q: Array) -> tuple[Array, Array]:
        """(m,) velocities upwards and downwards, both positive, of a command that goes on from (m,) joints."""
        if self.braking is None:
            return self.velocity, self.velocity
        up, down = self.braking.ahead(CYCLE).fastest(q)
        return np.minimum(up, self.velocity), np.minimum(down, self.velocity)

    def brakes(self, q: Array, v: Array, slack: float) -> bool:
        """Whether commands keep the velocity limits that depend on their positions.

        Args:
            q, v: (N, m) or (m,) commands, and the way to each from the one before by the cycle.
            slack: share of a limit, and rad/s, that arithmetic may be off.
        """
        if self.braking is None:
            return True
        up, down = self.braking.fastest(q)
        return bool((v <= (1.0 + slack) * up + slack).all() and (-v <= (1.0 + slack) * down + slack).all())

    @property
    def size(self) -> int:
        """m, joints of the arm."""
        return len(self.lower)

    def prepare(self) -> None:
        """Read and build what the first command would have to wait for."""
        here = self._open[None, list(self.profile.arm_columns)]
        self.tool(here)
        self.is_clear(here)

    @cached_property
    def scene(self) -> kpam.Scene:
        """The robot above its table."""
        pose = np.eye(4)
        pose[:3, 3] = [0.0, 0.0, -0.5 * _TABLE_DEPTH]
        sides = [_TABLE_SIDE, _TABLE_SIDE, 0.5 * _TABLE_DEPTH]
        table = kpam.Body("table", "table", [kpam.Shape.box(sides)], pose)
        return kpam.Scene(self.profile.model, [table])

    @cached_property
    def _open(self) -> Array:
        """(n,) all active joints with the fingers open."""
        joints = np.array(self.profile.reset_qpos, dtype=np.float64)
        joints[list(self.profile.gripper_columns)] = self.profile.gripper.at_command(1.0)
        return joints

    def whole(self, arm: Array) -> Array:
        """(N, n) all active joints of (N, m) of the arm: fingers open, which is where they need the most room."""
        rows = np.tile(self._open, (len(arm), 1))
        rows[:, list(self.profile.arm_columns)] = arm
        return rows

    def tool(self, arm: Array) -> Array:
        """(N, 3) places of the tool in the base frame, m, at (N, m) of the arm."""
        return np.asarray(self.profile.model.forward_kinematics(self.whole(arm), self.profile.tool_link)[:, :3, 3])

    def is_clear(self, arm: Array) -> bool:
        """Whether the robot keeps its clearance at all of (N, m) of the arm."""
        distance = np.asarray(self.scene.distance(self.whole(arm), 2.0 * self.clearance + 1e-3))
        return bool((distance >= self.clearance).all())

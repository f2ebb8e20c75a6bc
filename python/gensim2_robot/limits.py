"""Check and limit every command to an arm.

For every command, a complete stop from it is computed. The command and its stop are checked: positions, velocities,
accelerations, jerks, the tool's speed and workspace, and the distances of links and table.

If the check fails, commands between this command and the last checked stop are checked, and one that passes is sent. If
none passes, the arm continues the last checked stop. Therefore no request can make the arm exceed a limit.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array
from gensim2.core.errors import GenSim2Error
from gensim2_robot.arm_limits import CYCLE, ArmLimits

SLACK = 1e-9
"""Tolerance for rounding errors: for speeds and accelerations as a fraction of the limit, for positions in rad or m."""

_COUNTS = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 17, 20, 24, 29, 35, 42, 50, 60, 72, 86, 104, 125, 150, 180, 216, 260)
_EDGES = (0.0, 0.25, 0.5)


@dataclass(frozen=True, eq=False)
class Commands:
    """Sequence of N commands, one cycle apart.

    Attributes:
        q, v, a: (N, m) positions, and their first and second differences divided by the cycle time.
    """

    q: Array
    v: Array
    a: Array

    def __len__(self) -> int:
        return len(self.q)

    @staticmethod
    def none(size: int) -> Commands:
        return Commands(*(np.empty((0, size)) for _ in range(3)))

    def after(self, count: int) -> Commands:
        """Return the sequence without its first ``count`` commands."""
        return Commands(self.q[count:], self.v[count:], self.a[count:])


@cache
def _shapes(count: int) -> tuple[tuple[Array, Array, float, float], ...]:
    """Return acceleration profiles for stops that last ``count`` cycles.

    The acceleration during a stop is the sum of two parts. The first is the present acceleration, which decreases
    linearly. The second is a trapezoid that brakes and ends at zero.

    Returns:
        For each trapezoid, the values of the linear part and of the trapezoid (count, 1), and the sums of both.
    """
    cycle = np.arange(1, count + 1, dtype=np.float64)
    away = (count - cycle) / count
    found = []
    for edge in dict.fromkeys(max(1, round(share * count)) for share in _EDGES):
        bump = np.minimum(1.0, np.minimum(cycle, count - cycle) / edge)
        found.append((away[:, None], bump[:, None], float(away.sum()), float(bump.sum())))
    return tuple(found)


def quickest_stop(q: Array, v: Array, a: Array, limits: ArmLimits) -> Commands | None:
    """Return the fastest stop found within the joint limits; None if no stop was found.

    Args:
        q, v, a: (m,) position, velocity and acceleration of the last command.
        limits: limits of position, velocity, acceleration and jerk.
    """
    if not v.any() and not a.any():
        return Commands.none(limits.size)
    most_v, most_a, most_j = (
        (1.0 + SLACK) * each for each in (limits.velocity, limits.acceleration, CYCLE * limits.jerk)
    )
    least = float((np.abs(v) / (CYCLE * limits.acceleration)).max())
    for count in _COUNTS:
        if count < least:
            continue
        for away, bump, sum_away, sum_bump in _shapes(count):
            if sum_bump == 0.0:
                continue
            height = (-v / CYCLE - a * sum_away) / sum_bump
            rates = away * a + bump * height
            if (np.abs(rates) > most_a).any() or (np.abs(np.diff(rates, axis=0, prepend=a[None])) > most_j).any():
                continue
            speeds = v + CYCLE * np.cumsum(rates, axis=0)
            # By construction the last speed is zero except for rounding errors, which are removed here.
            speeds[-1] = 0.0
            if (np.abs(speeds) > most_v).any():
                continue
            places = q + CYCLE * np.cumsum(speeds, axis=0)
            inside = (places >= limits.lower - SLACK).all() and (places <= limits.upper + SLACK).all()
            if inside and limits.brakes(places, speeds, SLACK):
                rates[-1] = 0.0
                return Commands(places, speeds, rates)
    return None


_MIXTURES = (1.0, 0.5, 0.25, 0.1)
"""Weights of the requested motion that are tried when it is mixed with the checked stop."""

_CLOSE = 1e-9
"""A command that differs from the request by at most this amount (rad or m) counts as equal to the request."""


class RefusedError(GenSim2Error):
    """A target, or the arm's state, does not allow the arm to continue; the message names the reason."""


@dataclass(frozen=True, eq=False)
class Sent:
    """The last command, and the checked stop that would follow it.

    Attributes:
        q, v, a: (m,) position of the command, and its velocity and acceleration by finite differences.
        stop: commands that bring the arm to rest after this command.
        clips: names of the limits that changed the command.
    """

    q: Array
    v: Array
    a: Array
    stop: Commands
    clips: tuple[str, ...] = field(default=())

    @property
    def is_at_rest(self) -> bool:
        return len(self.stop) == 0 and not self.v.any()


def begin(q: npt.ArrayLike, limits: ArmLimits) -> Sent:
    """Return the first command, at the arm's measured position.

    Args:
        q: (m,) measured joints, rad or m.
        limits: limits of every command.

    Returns:
        A command to stay at these positions.

    Raises:
        RefusedError: the arm is outside its limits, so no motion from the present position can be checked.
    """
    here = _finite(q, limits)
    for number, (value, low, high) in enumerate(zip(here, limits.lower, limits.upper, strict=True)):
        if not low <= value <= high:
            name = limits.profile.arm_joints[number]
            raise RefusedError(
                f"{name} is at {value:.3f}, outside its range from {low:.3f} to {high:.3f}: move the arm by hand first"
            )
    tool = limits.tool(here[None])[0]
    if not ((tool >= limits.low) & (tool <= limits.high)).all():
        raise RefusedError(f"the tool is at {np.round(tool, 3).tolist()}, outside the workspace")
    if not limits.is_clear(here[None]):
        raise RefusedError(f"two links of the robot, or the robot and the table, are closer than {limits.clearance} m")
    return Sent(here, np.zeros(limits.size), np.zeros(limits.size), Commands.none(limits.size))


def admit(action: npt.ArrayLike, limits: ArmLimits, here: Array | None = None) -> Array:
    """Check an action of a controller before the control loop uses the action.

    Args:
        action: (m + 1,) targets of the arm's joints, then the gripper command from -1 to 1.
        here: (m,) current position of the arm, for the first action of an episode; None for later actions.

    Returns:
        The action (m + 1,), with the gripper command clipped to -1..1.

    Raises:
        RefusedError: the target has a wrong shape, is not finite or is too far outside the joint range, or it is the
            first target and too far away.
    """
    try:
        given = np.asarray(action, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise RefusedError(f"an action must consist of numbers: {error}") from error
    if given.shape != (limits.size + 1,):
        raise RefusedError(f"an action must have the shape ({limits.size + 1},), but has {given.shape}")
    if not np.isfinite(given).all():
        raise RefusedError("an action contains NaN or infinity")
    arm = given[:-1]
    beyond = np.maximum(limits.range_lower - arm, arm - limits.range_upper)
    worst = int(beyond.argmax())
    if beyond[worst] > limits.jump:
        raise RefusedError(
            f"{limits.profile.arm_joints[worst]} cannot reach its target {arm[worst]:.3f}, outside the joint's range"
        )
    if here is not None:
        off = np.abs(arm - here)
        worst = int(off.argmax())
        if off[worst] > limits.jump:
            name = limits.profile.arm_joints[worst]
            wrong = f"the first action moves {name} by {off[worst]:.2f}, more than the limit of {limits.jump:g}"
            raise RefusedError(wrong)
    return np.append(arm, np.clip(given[-1], -1.0, 1.0))


def limit(
    sent: Sent,
    target: npt.ArrayLike,
    limits: ArmLimits,
    force: float = 0.0,
    measured: Array | None = None,
    v_measured: Array | None = None,
    recent: float = 0.0,
) -> Sent:
    """Return the next command: the target if it respects all limits, else a command towards the target that does.

    This is a pure function.

    Args:
        sent: the last command.
        target: (m,) requested positions, rad or m.
        limits: limits of every command.
        force: measured contact force, N.
        measured: (m,) last measured positions, rad or m; None if unknown.
        v_measured: (m,) last measured velocities, rad/s or m/s; None: the arm stands still.
        recent: contact force (N) of the recent past, which reduces the leash like ``force``.

    Returns:
        The command 10 ms after ``sent``, with its checked stop and the limits that changed it.

    Raises:
        RefusedError: the target is not finite, or the contact force exceeds its limit.
    """
    check_force(force, limits)
    wanted = _finite(target, limits)
    clips: list[str] = []
    standing = np.zeros(limits.size)
    if measured is not None:
        leash = limits.leash_under(max(force, recent), standing if v_measured is None else v_measured)
        near = np.clip(wanted, measured - leash, measured + leash)
        if (near != wanted).any():
            wanted, clips = near, ["leash"]
    rate = _rate_towards(sent, wanted, limits, clips)
    back = sent.stop.a[0] if len(sent.stop) else standing
    for share in _MIXTURES:
        a = rate if share == 1.0 else back + share * (rate - back)
        v = sent.v + CYCLE * a
        q = sent.q + CYCLE * v
        stop = _checked(sent.q, q, v, a, limits, clips)
        if stop is not None:
            if np.abs(q - np.asarray(target)).max() <= _CLOSE:
                clips.clear()
            return Sent(q, v, a, stop, tuple(dict.fromkeys(clips)))
    if not len(sent.stop):
        return Sent(sent.q, standing, standing, sent.stop, tuple(dict.fromkeys(clips)))
    q, v, a = sent.stop.q[0], sent.stop.v[0], sent.stop.a[0]
    return Sent(q, v, a, sent.stop.after(1), tuple(dict.fromkeys(clips)))


def check_force(force: float, limits: ArmLimits) -> None:
    """Check that the contact force (N) allows further commands.

    Raises:
        RefusedError: the contact force exceeds its limit.
    """
    if not force <= limits.force:
        raise RefusedError(f"the contact force on the arm is {force:.0f} N, but the limit is {limits.force:g} N")


def halt(sent: Sent) -> Sent:
    """Return the next command of the checked stop.

    Args:
        sent: the last command.

    Returns:
        The command 10 ms after ``sent``, with empty ``clips``. At rest it repeats its position.
    """
    if not len(sent.stop):
        standing = np.zeros_like(sent.v)
        return Sent(sent.q, standing, standing, sent.stop)
    return Sent(sent.stop.q[0], sent.stop.v[0], sent.stop.a[0], sent.stop.after(1))


def _finite(values: npt.ArrayLike, limits: ArmLimits) -> Array:
    found = np.array(values, dtype=np.float64)
    if found.shape != (limits.size,):
        raise RefusedError(f"a target must have the shape ({limits.size},), but has {found.shape}")
    if not np.isfinite(found).all():
        raise RefusedError("a target contains NaN or infinity")
    return found


def _rate_towards(sent: Sent, wanted: Array, limits: ArmLimits, clips: list[str]) -> Array:
    """Return the acceleration (m,) of the next cycle towards the target that still permits a stop."""
    inside = np.clip(wanted, limits.lower, limits.upper)
    if (inside != wanted).any():
        clips.append("position")
    way = inside - sent.q
    speed = way / CYCLE
    rate = (speed - sent.v) / CYCLE
    change = rate - sent.a
    up, down = limits.fastest_from(sent.q)
    fastest = np.where(way > 0.0, up, down)
    passed = {
        "velocity": np.abs(speed) > fastest,
        "acceleration": np.abs(rate) > limits.acceleration,
        "jerk": np.abs(change) > CYCLE * limits.jerk,
    }
    late = np.zeros(limits.size, dtype=bool)
    for name, which in passed.items():
        if which.any():
            clips.append(name)
        late |= which
    slow = np.minimum(fastest, np.sqrt(limits.acceleration * np.abs(way)))
    speed = np.where(late, np.sign(way) * np.minimum(slow, np.abs(speed)), speed)
    rate = np.clip((speed - sent.v) / CYCLE, -limits.acceleration, limits.acceleration)
    return np.clip(rate, sent.a - CYCLE * limits.jerk, sent.a + CYCLE * limits.jerk)


def _checked(before: Array, q: Array, v: Array, a: Array, limits: ArmLimits, clips: list[str]) -> Commands | None:
    """Return the stop after a command if the command and the stop respect all limits.

    Otherwise return None and add the limit to ``clips``.
    """
    if (q < limits.lower - SLACK).any() or (q > limits.upper + SLACK).any():
        clips.append("position")
        return None
    if (np.abs(v) > (1.0 + SLACK) * limits.velocity).any() or not limits.brakes(q, v, SLACK):
        clips.append("velocity")
        return None
    stop = quickest_stop(q, v, a, limits)
    if stop is None:
        clips.append("position")
        return None
    rows = np.concatenate([before[None], q[None], stop.q])
    tool = limits.tool(rows)
    if (np.linalg.norm(np.diff(tool, axis=0), axis=1) > (1.0 + SLACK) * CYCLE * limits.tool_speed).any():
        clips.append("tool speed")
        return None
    if (tool[1:] < limits.low).any() or (tool[1:] > limits.high).any():
        clips.append("workspace")
        return None
    if not limits.is_clear(rows[1:]):
        clips.append("clearance")
        return None
    return stop

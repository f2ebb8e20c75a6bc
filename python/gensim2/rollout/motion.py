"""Displacements between two instants, and whether they are at rest."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from gensim2.robots import RobotProfile
from gensim2.tasks.measurement import Measurement

Array = npt.NDArray[np.float64]

SETTLED_CHANGE = 0.02
"""Change of openness a second, over one control step, below which a joint counts as settled."""

SETTLED_DISTANCE = 0.01
"""Speed (m/s) over one control step below which a rigid object counts as settled."""

SETTLED_TURN = 0.5
"""Rad/s over one control step below which a rigid object counts as settled: at which a ball that rolls in place is no
matter."""

LARGEST_OVERSHOOT = 0.5
"""Openness by which a joint may stand outside 0..1; the give of its limits is a hundredth of that."""

FARTHEST = 10.0
"""Metres from the world's origin at which a rigid object may be; one that falls off the table stays nearer."""


@dataclass(frozen=True)
class Change:
    """Change of one object between two instants.

    Attributes:
        openness: change of its joint's openness, signed; 0 of a rigid object.
        distance: metres that a rigid object went; 0 of an articulated one, whose root stands fast.
        turn: rad that it turned by, about whatever axis.
        tilt: rad between its former and its present upright.
    """

    openness: float = 0.0
    distance: float = 0.0
    turn: float = 0.0
    tilt: float = 0.0

    def exceeds(self, openness: float, distance: float) -> bool:
        """Whether it is more than that; NaN always is."""
        return not (abs(self.openness) <= openness and self.distance <= distance)


def change(before: Measurement, after: Measurement, name: str) -> Change:
    """Return the change of one object."""
    if name in after.openness:
        return Change(openness=after.openness[name] - before.openness[name])
    then, now = before.poses[name], after.poses[name]
    if not np.isfinite([then, now]).all():
        return Change(distance=math.nan, turn=math.nan, tilt=math.nan)
    turned = _rotation(now) * _rotation(then).inv()
    upright = turned.apply([0.0, 0.0, 1.0])[2]
    return Change(
        distance=math.dist(then[:3], now[:3]),
        turn=float(turned.magnitude()),
        tilt=math.acos(max(-1.0, min(1.0, float(upright)))),
    )


def changes(before: Measurement, after: Measurement) -> Mapping[str, Change]:
    """Return the change of every object."""
    return {name: change(before, after, name) for name in (*after.openness, *after.poses)}


def is_at_rest(before: Measurement, after: Measurement, period: float) -> bool:
    """Whether nothing moved to speak of from one control step to the next, which is ``period`` (s) later."""
    return all(
        not moved.exceeds(SETTLED_CHANGE * period, SETTLED_DISTANCE * period) and moved.turn <= SETTLED_TURN * period
        for moved in changes(before, after).values()
    )


def is_stable(measured: Measurement) -> bool:
    """Whether physics holds together; once it has blown up, positions stay NaN or far out."""
    return all(-LARGEST_OVERSHOOT <= value <= 1 + LARGEST_OVERSHOOT for value in measured.openness.values()) and all(
        bool(np.isfinite(pose).all()) and float(np.abs(pose[:3]).max()) <= FARTHEST for pose in measured.poses.values()
    )


def _rotation(pose: Array) -> Rotation:
    return Rotation.from_quat(pose[3:], scalar_first=True)


GOAL_SECONDS = 0.5
"""For which the goal holds without a break before it ends an episode."""

SETTLE_SECONDS = 0.5
"""For which the last command is held in any case."""

MAX_SETTLE_SECONDS = 2.0
"""After which an episode is judged although something still moves."""

LASTING_SECONDS = 1.0
"""After which a goal that lasts is still there; they count from the last command, too."""


def may_judge(held: float, at_rest: bool | None, unit: Callable[[float], float] = float) -> bool:
    """Whether the last command has been held for long enough to judge the episode.

    Args:
        held: time for which it has been held; s, or in the unit that ``unit`` gives.
        at_rest: whether the scene is at rest; None: it is not measured, and not waited for.
        unit: of seconds, as control steps: :meth:`RobotProfile.steps`.
    """
    return held >= unit(MAX_SETTLE_SECONDS) or (held >= unit(SETTLE_SECONDS) and at_rest is not False)


def settle(step: Callable[[], Measurement], before: Measurement, profile: RobotProfile) -> bool:
    """Hold the last command until the episode may be judged; return whether the scene is at rest.

    Args:
        step: makes one control step with the last command, and measures.
        before: measurement before the first of these steps.
        profile: says how long a control step is.
    """
    held, at_rest = 0, False
    while not may_judge(held, at_rest, profile.steps):
        after = step()
        at_rest = is_at_rest(before, after, 1.0 / profile.control_hz)
        before, held = after, held + 1
    return at_rest

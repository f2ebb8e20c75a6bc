"""Stops in commands: from any speed and acceleration to rest, in cycles of the wire."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from gensim2_robot.arm_limits import CYCLE, ArmLimits, Array

SLACK = 1e-9
"""Share by which arithmetic may be off a limit."""

_COUNTS = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 17, 20, 24, 29, 35, 42, 50, 60, 72, 86, 104, 125, 150, 180, 216, 260)
_EDGES = (0.0, 0.25, 0.5)


@dataclass(frozen=True, eq=False)
class Commands:
    """Commands one cycle apart, as they were or will be sent.

    Attributes:
        q, v, a: (N, m) positions, and the differences of positions and of velocities by the cycle.
    """

    q: Array
    v: Array
    a: Array

    def __len__(self) -> int:
        return len(self.q)

    @staticmethod
    def none(size: int) -> Commands:
        """No command of an arm with so many joints."""
        return Commands(*(np.empty((0, size)) for _ in range(3)))

    def after(self, count: int) -> Commands:
        """Return the commands after the first so many."""
        return Commands(self.q[count:], self.v[count:], self.a[count:])


@cache
def _shapes(count: int) -> tuple[tuple[Array, Array, float, float], ...]:
    """Accelerations in so many cycles: one that dies away, and a trapezoid that ends at zero; and the sums of both."""
    cycle = np.arange(1, count + 1, dtype=np.float64)
    away = (count - cycle) / count
    found = []
    for edge in dict.fromkeys(max(1, round(share * count)) for share in _EDGES):
        bump = np.minimum(1.0, np.minimum(cycle, count - cycle) / edge)
        found.append((away[:, None], bump[:, None], float(away.sum()), float(bump.sum())))
    return tuple(found)


def quickest_stop(q: Array, v: Array, a: Array, limits: ArmLimits) -> Commands | None:
    """The quickest stop of those known that keeps velocities, accelerations, jerks and positions; None: none does.

    Args:
        q, v, a: (m,) of the last command.
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
            speeds[-1] = 0.0  # but for rounding
            if (np.abs(speeds) > most_v).any():
                continue
            places = q + CYCLE * np.cumsum(speeds, axis=0)
            inside = (places >= limits.lower - SLACK).all() and (places <= limits.upper + SLACK).all()
            if inside and limits.brakes(places, speeds, SLACK):
                rates[-1] = 0.0
                return Commands(places, speeds, rates)
    return None

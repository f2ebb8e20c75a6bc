"""Settling: the last command is held before an episode is judged, in a rollout, on the line and for LeRobot alike."""

from __future__ import annotations

from collections.abc import Callable

from gensim2.robots import RobotProfile
from gensim2.rollout.motion import is_at_rest
from gensim2.tasks.measurement import Measurement

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

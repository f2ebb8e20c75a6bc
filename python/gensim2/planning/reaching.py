"""Plan a motion that touches the target only at the actuation pose, if possible."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import gensim2_kpam as kpam

#: Clearances (m) to try in turn: more than the drives' tracking error, a minimal one, none.
REACH_CLEARANCES: tuple[float | None, ...] = (0.003, 0.001, None)

#: Statuses of a plan that may not have found a usable actuation pose, so that a shifted pose may help.
SHORT = ("collision", "not_found", "unreachable")

#: A partial motion counts as longer if it exceeds the other by this share of the motion after the actuation pose.
LONGER = 0.01


@dataclass(frozen=True)
class Reach:
    """A motion, and the clearance of its approach.

    Attributes:
        problem: solved problem.
        plan: plan of the solver.
        clearance: requested clearance, m.
        touches: obstacle that prevents a motion without contact before the actuation pose; None if the motion has no
            such contact.
    """

    problem: kpam.KeypointProblem
    plan: kpam.Plan
    clearance: float | None
    touches: str | None


def reach(
    problem_with: Callable[[kpam.Options], kpam.KeypointProblem],
    clearances: Sequence[float | None] = REACH_CLEARANCES,
    warm_start: kpam.Plan | None = None,
    explain: bool = False,
) -> Reach:
    """Plan a motion that keeps clear of the target until the hand is at the actuation pose.

    The clearances are tried in turn, and the first complete motion is used. The last clearance (None) lets hand and
    fingers touch the target in the last segment before the actuation pose, since a motion with contact is better than
    none. If no clearance gives a complete motion, the attempts without a usable pose are repeated with poses shifted
    out of overlaps. If this fails, too, the longest partial motion is used, with the largest clearance.

    Args:
        problem_with: returns the problem with these options in place of its own.
        clearances: m; None for no clearance.
        warm_start: earlier plan of the same step, whose pose and path are tried first.
        explain: whether the plan reports the result of every pose that was tried.
    """
    tried: list[Reach] = []

    def solves(clearance: float | None, budget: kpam.Options) -> bool:
        problem = problem_with({**budget, "reach_clearance": clearance})
        plan = kpam.plan(problem, warm_start=warm_start, explain=explain)
        gentle = next((each.plan.reason for each in tried if each.clearance), None)
        tried.append(Reach(problem, plan, clearance, None if clearance else gentle))
        return plan.status == "solved"

    for clearance in clearances:
        if solves(clearance, {"clearings": 0}):
            return tried[-1]
    for clearance in [each.clearance for each in tried if each.plan.status in SHORT]:
        if solves(clearance, {}):
            return tried[-1]
    gentlest, *others = sorted(tried, key=lambda each: clearances.index(each.clearance))
    best = gentlest
    for each in others:
        if _extent(each.plan) > _extent(best.plan) + LONGER:
            best = each
    return best


def _extent(plan: kpam.Plan) -> float:
    """Return the extent of a motion: 0 without a trajectory, else 1 plus the completed share after the actuation
    pose.
    """
    return 0.0 if plan.trajectory is None else 1.0 + plan.reached_fraction

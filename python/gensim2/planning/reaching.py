"""Plan a motion to the actuation pose, if possible without contact with the target before that pose."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import gensim2_kpam as kpam

#: Clearances (m) between hand and target, tried in this order; the first exceeds the drives' tracking error.
REACH_CLEARANCES: tuple[float | None, ...] = (0.003, 0.001, None)

#: Statuses of plans that are repeated with shifted actuation poses, because the first pose may be unusable.
SHORT = ("collision", "not_found", "unreachable")

#: Minimum difference of completed fractions at which a partial motion counts as longer than another one.
LONGER = 0.01


@dataclass(frozen=True)
class Reach:
    """Result of :func:`reach`: a motion, and the clearance from the target that was requested for its approach.

    Attributes:
        problem: solved problem.
        plan: plan of the solver.
        clearance: requested clearance, m.
        touches: reason why planning with a clearance failed, if ``plan`` may touch the target early; else None.
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

    Clearances are tried in order, and the first complete motion is returned. With the clearance None, which usually is
    the last, the hand may touch the target in the last segment before the actuation pose. If all clearances fail,
    attempts without a usable hand pose (status in ``SHORT``) are repeated with shifted poses. If they fail too, the
    longest partial motion is returned; of equally long motions, the one with the largest clearance.

    Args:
        problem_with: function that returns the problem with the given solver options.
        clearances: clearances to try, m; None for no clearance.
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
    """Return 0 without a trajectory, else 1 plus the completed fraction of the motions after actuation."""
    return 0.0 if plan.trajectory is None else 1.0 + plan.reached_fraction

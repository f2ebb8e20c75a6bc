"""Plan a motion that, if possible, does not touch its target before the actuation pose."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import gensim2_kpam as kpam

#: Clearances (m) between hand and target, tried in this order; the first exceeds the drives' tracking error.
REACH_CLEARANCES: tuple[float | None, ...] = (0.003, 0.001, None)

#: Plan statuses after which the planner tries shifted actuation poses, because each of these statuses may mean that the
#: first poses were unusable.
SHORT = ("collision", "not_found", "unreachable")

#: A partial motion counts as longer than another one if it completes at least this much more of the motion after
#: actuation, as a fraction.
LONGER = 0.01


@dataclass(frozen=True)
class Reach:
    """Result of :func:`reach`: a motion, and the clearance from the target that was requested for its approach.

    Attributes:
        problem: solved problem.
        plan: plan of the solver.
        clearance: requested clearance, m.
        touches: body that the approach has to touch before the actuation pose; None if the approach touches nothing.
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

    The planner tries the clearances in turn and returns the first complete motion. The last clearance (None) lets hand
    and fingers touch the target in the last segment before the actuation pose. If every clearance fails, the planner
    repeats the attempts in which all poses collided; this time the solver shifts colliding poses until they are free.
    If these fail, too, the longest partial motion is returned, with the largest clearance.

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
    """Return how far a plan gets, to compare partial plans.

    0: the plan has no trajectory. Otherwise 1 plus the fraction, from 0 to 1, of the motions after actuation that the
    plan completes.
    """
    return 0.0 if plan.trajectory is None else 1.0 + plan.reached_fraction

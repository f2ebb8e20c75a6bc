"""Reaching for a thing without moving it: nothing touches it before the actuation pose, where that can be had."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import gensim2_kpam as kpam

#: Clearances (m) that are asked for one after the other: more than the drives stray from their way, a hair, none.
REACH_CLEARANCES: tuple[float | None, ...] = (0.003, 0.001, None)

#: Outcomes of a plan that may get past none of the actuation poses that it tried: moved ones may serve.
SHORT = ("collision", "not_found", "unreachable")

#: A motion is longer than another where it goes this much further, of what comes after the actuation pose.
LONGER = 0.01


@dataclass(frozen=True)
class Reach:
    """A motion, and how it comes to its actuation pose.

    Attributes:
        problem: that it solves.
        plan: the planner's.
        clearance: that was asked for, m.
        touches: what stands in the way of one that touches nothing before the actuation pose; None: this one does not.
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
    """Plan a motion that keeps clear of what the hand reaches for until it is at the actuation pose.

    The clearances are asked for in turn; the first whole motion is taken. The last (None) lets hand and fingers touch
    what they reach for in the last segment before the actuation pose: a motion that gets it done comes before one that
    is gentle. Where none of them allows one, those that got to no pose are asked for again with poses that are moved
    out of what they overlap: such poses barely fit. Where that is no whole motion either, the gentlest of
    the longest parts is taken.

    Args:
        problem_with: the problem with options that take the place of its own.
        clearances: m; None for none.
        warm_start: an earlier plan of the same step; its pose and its way are tried first.
        explain: whether the plan says what became of every pose that was tried.
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
    """Return the extent of a motion: 0 without a trajectory, else 1 and the part of what comes after the actuation."""
    return 0.0 if plan.trajectory is None else 1.0 + plan.reached_fraction

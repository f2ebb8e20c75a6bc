"""Every planned trajectory of random problems passes an independent checker."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import gensim2_kpam as kpam

pytest.importorskip("coal")
pytest.importorskip("pinocchio")

from random_plans import errors_of
from recheck import answer_of, recheck

from .random_problems import RandomProblem, arm_problem, random_problem

#: Numbers of random problems on their own arms and on six arms, and of those that a single test checks.
#: ``benchmarks/random_plans.py`` tries 20,000.
PROBLEMS, ON_SIX_ARMS, SHARE = 100, 400, 100

#: Problems on six arms with a former bug: leaving an overlap, the hand went into something else; or the approach went
#: as near to an object as at its end, which it touches, without reporting it in ``tight``.
ONCE_FALSE = (50_043, 111, 6_609)


def traits(problem: RandomProblem, plan: kpam.Plan) -> list[str]:
    """Return the properties of a motion that make it worth a test."""
    roles = {thing.role for thing in problem.things}
    joints = problem.mechanism.joints
    found = {
        "mimic": bool(problem.mechanism.couplings),
        "prismatic": any(not joint.turns for joint in joints),
        "continuous": any(not np.isfinite(joint.lower) for joint in joints),
        "bare tool frame": problem.arm.hand not in problem.mechanism.parts,
        "start velocity": bool(problem.start_velocity.any()),
        "held object": "attached" in roles,
        "moving joint": "moving_link" in roles,
        "scene": bool(roles & {"rigid", "object_body"}),
        "lets go": any(frame["label"] == "let_go" and frame["reached"] for frame in plan.keyframes),
        "few joints": len(problem.mechanism.movers(problem.arm.hand)) < 6,
    }
    return [plan.status, *(name for name, holds in found.items() if holds)]


@pytest.mark.parametrize("first", range(0, PROBLEMS, SHARE))
def test_random_problems(first: int, tmp_path: Path) -> None:
    wrong: list[str] = []
    seen: Counter[str] = Counter()
    for number in range(first, first + SHARE):
        problem = random_problem(number)
        assert problem.mechanism.disagreement(problem.q_start[None]) < 1e-9, "our own kinematics"
        plan = kpam.plan(problem.ours(tmp_path))
        assert (plan.status in ("solved", "partial")) == (plan.trajectory is not None), f"problem {number}: {plan}"
        if plan.trajectory is None:
            continue
        seen.update(traits(problem, plan))
        verdict = recheck(problem.question(), answer_of(plan))
        wrong += [f"problem {number}: {error}" for error in verdict.errors]
    assert not wrong, "\n".join(wrong)
    # A planner that refuses everything would pass, so most must be solved; some can be solved only in deep contact.
    assert seen["solved"] >= 0.4 * SHARE
    wanted = ("mimic", "prismatic", "continuous", "start velocity", "held object", "lets go")
    assert min(seen[name] for name in wanted) > 0, seen


@pytest.mark.parametrize("first", range(0, ON_SIX_ARMS, SHARE))
def test_random_problems_on_six_arms(first: int, robots: Path, tmp_path: Path) -> None:
    """The first of the 20,000 of ``benchmarks/random_plans.py``."""
    wrong: list[str] = []
    solved = 0
    for number in range(first, first + SHARE):
        status, errors = errors_of(number, robots, tmp_path)
        wrong += [f"problem {number}: {error}" for error in errors]
        solved += status == "solved"
    assert not wrong, "\n".join(wrong)
    assert solved >= 0.4 * SHARE


@pytest.mark.parametrize("number", ONCE_FALSE)
def test_what_was_false_once_is_not(number: int, robots: Path, tmp_path: Path) -> None:
    assert errors_of(number, robots, tmp_path)[1] == []


def test_what_a_plan_does_not_tell_of_is_found(robots: Path, tmp_path: Path) -> None:
    problem = arm_problem(111, robots)
    answer = answer_of(kpam.plan(problem.ours(tmp_path)))
    assert recheck(problem.question(), answer).errors == []
    answer.nearer.discard(frozenset(("hand", "flap")))
    (error,) = recheck(problem.question(), answer).errors
    assert error.startswith("not told of: hand is")

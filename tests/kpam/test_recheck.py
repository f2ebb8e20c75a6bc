"""Every trajectory that the planner emits for random problems holds when other code looks at it."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import gensim2_kpam as kpam

pytest.importorskip("coal")
pytest.importorskip("pinocchio")

from recheck import answer_of, recheck

from .random_problems import RandomProblem, random_problem

#: Random problems, and how many a test looks at, so that a failure is found early.
PROBLEMS, SHARE = 2000, 100


def traits(problem: RandomProblem, plan: kpam.Plan) -> list[str]:
    """What makes an emitted motion worth a look."""
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
        if plan.trajectory is None:
            continue
        seen.update(traits(problem, plan))
        verdict = recheck(problem.question(), answer_of(plan))
        wrong += [f"problem {number}: {error}" for error in verdict.errors]
    assert not wrong, "\n".join(wrong)
    # A planner that refuses everything would pass; about three in four of these can be solved.
    assert seen["solved"] >= SHARE // 2
    wanted = ("mimic", "prismatic", "continuous", "start velocity", "held object", "lets go")
    assert min(seen[name] for name in wanted) > 0, seen

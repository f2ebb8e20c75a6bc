"""Plan recorded problems again from the middle of their motions.

    python benchmarks/replans.py --problems plans.jsonl [--assets DIR] [--every N] [--json OUT]

Each whole plan is left at 30 % and 60 % of its motion, in the state that it has there, and the rest is planned anew
with the plan as the earlier one. Prints how many are solved, with a trajectory that begins in that state, and CPU
times; ends with 1 where one is not.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np

import gensim2_kpam as kpam
from gensim2 import robots
from gensim2.bench.problems import read_problems
from gensim2.bench.scene import problem_scene
from gensim2.bench.solver import keypoint_problem

SHARES = (0.3, 0.6)


def again(question: kpam.KeypointProblem, plan: kpam.Plan, share: float, *, moving: bool) -> kpam.Plan:
    """The rest of a plan's motion from a share of its time on, from its velocity there or from rest."""
    assert plan.trajectory is not None
    times = plan.trajectory.times
    now = float(times[0] + share * plan.trajectory.duration)
    q, velocity, acceleration = plan.trajectory.sample(now)
    label = next(frame["label"] for frame in plan.keyframes if frame["time"] is not None and frame["time"] > now)
    start = question.with_start(q, velocity if moving else None, now, acceleration=acceleration if moving else None)
    return kpam.plan(start, warm_start=plan, resume=label)


def fault(found: kpam.Plan, plan: kpam.Plan, share: float, *, moving: bool) -> str | None:
    """Return the errors in the rest of a motion: no whole motion, or one that does not begin where it should."""
    if found.status != "solved":
        return found.reason
    if found.trajectory is None:
        return "solved without a trajectory"
    assert plan.trajectory is not None
    q, velocity, _ = plan.trajectory.sample(float(plan.trajectory.times[0] + share * plan.trajectory.duration))
    first, speed, _ = found.trajectory.sample(found.trajectory.times[0])
    off = max(np.abs(first - q).max(), np.abs(speed - (velocity if moving else 0.0)).max())
    return f"begins {off:.2e} beside the state that it was to begin in" if off > 1e-6 else None


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=Path, required=True)
    parser.add_argument("--assets", type=Path)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--from-rest", action="store_true", help="leave the velocity out")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    robot = robots.robot("panda").model
    first, rest, failed = [], [], []
    for problem in read_problems(arguments.problems)[:: arguments.every]:
        hand = robot.forward_kinematics(np.asarray(problem.q_current))
        question = keypoint_problem(problem, problem_scene(problem, arguments.assets, hand), robot)
        plan = kpam.plan(question)
        if plan.status != "solved":
            continue
        first.append(plan.cpu_ms["total"])
        for share in SHARES:
            found = again(question, plan, share, moving=not arguments.from_rest)
            rest.append(found.cpu_ms["total"])
            if (wrong := fault(found, plan, share, moving=not arguments.from_rest)) is not None:
                failed.append({"id": problem.id, "share": share, "status": found.status, "reason": wrong})
    figures = {
        "whole plans": len(first),
        "re-plans": len(rest),
        "re-plans solved": len(rest) - len(failed),
        "plan, CPU ms, median": float(np.median(first)),
        "re-plan, CPU ms, median": float(np.median(rest)),
        "re-plan, CPU ms, 95th percentile": float(np.percentile(rest, 95)),
        "re-plan, CPU ms, longest": float(np.max(rest)),
    }
    for name, value in figures.items():
        print(f"{name:34} {value:.3f}" if isinstance(value, float) else f"{name:34} {value}")
    for entry in failed:
        print(f"not solved: {entry['id']} from {entry['share']:.0%}: {entry['reason']}")
    if arguments.json is not None:
        arguments.json.write_text(json.dumps({"figures": figures, "failed": failed}, indent=2) + "\n")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

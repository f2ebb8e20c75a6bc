"""Measure how much faster ``plan_batch`` runs with several threads, on a file of planning problems.

    python benchmarks/batch.py --problems FILE [--assets DIR] [--threads 2] [--repeats 5]

The script measures the wall time of the batch on one thread and on several threads, alternately. The
fastest repeat counts, because other processes on the machine can only slow a run down. The exit code is 1 if the number
of threads changes a plan.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

import gensim2_kpam as kpam
from gensim2 import robots
from gensim2.bench.problems import read_problems
from gensim2.bench.scene import check_assets, problem_scene
from gensim2.bench.solver import keypoint_problem


def questions(problems: Path, assets: Path | None) -> list[kpam.KeypointProblem]:
    """Return the problems of a file with their scenes."""
    robot = robots.robot("panda").model
    folder = None if assets is None else check_assets(assets)
    return [
        keypoint_problem(
            problem,
            problem_scene(problem, folder, robot.forward_kinematics(np.asarray(problem.q_current))),
            robot,
            frames="original",
        )
        for problem in read_problems(problems)
    ]


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return 1 if the number of threads changes a result."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=Path, required=True)
    parser.add_argument("--assets", type=Path)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args(arguments)
    batch = questions(options.problems, options.assets)
    best: dict[int, float] = {}
    answers: dict[int, list[dict[str, object]]] = {}
    for _ in range(options.repeats):
        for threads in (1, options.threads):
            begin = time.perf_counter()
            plans = kpam.plan_batch(batch, threads)
            spent = time.perf_counter() - begin
            best[threads] = min(spent, best.get(threads, spent))
            answers[threads] = [plan.to_dict() for plan in plans]
    for threads, seconds in best.items():
        print(f"{threads} thread{'s' * (threads > 1)}: {1e3 * seconds:.0f} ms for {len(batch)} problems")
    print(f"ratio: {best[1] / best[options.threads]:.2f}")
    same = answers[1] == answers[options.threads]
    print(f"same plans: {'yes' if same else 'NO'}")
    return int(not same)


if __name__ == "__main__":
    sys.exit(main())

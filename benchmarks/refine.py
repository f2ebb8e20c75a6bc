"""Cost saved by refinement, by the original's own trajectory cost, beside Drake's trajectories.

    python benchmarks/refine.py --problems plans.jsonl [--assets DIR] [--every 4] [--drake 12]

Waypoints lie where the original has them (one a second, two a second from the last pre-actuation keyframe on); the cost
is weighted squared joint steps, 10 for the first joint. Drake solves the original's program (no collisions, no joint
limits) through the keyframes of the same actuation pose, for as many of the problems as ``--drake`` says. Times are CPU
time.
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

WEIGHTS = np.array([10.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])


def cost_of(waypoints: np.ndarray) -> float:
    """The original's trajectory cost of (N, 7 or more) waypoints, its fingers left out."""
    return float((np.diff(waypoints[:, :7], axis=0) ** 2 @ WEIGHTS).sum())


def refined(
    question: kpam.KeypointProblem, plan: kpam.Plan, times: np.ndarray, keep: bool
) -> tuple[kpam.Refined, float]:
    """A refinement, and CPU ms that it took."""
    begin = time.process_time()
    found = kpam.refine(question, plan, times=times, keep_paths=keep)
    return found, 1e3 * (time.process_time() - begin)


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns 1 where a refinement is worse than what it began with."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=Path, required=True)
    parser.add_argument("--assets", type=Path)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--drake", type=int, default=0, help="number of problems that Drake solves as well")
    options = parser.parse_args(arguments)
    from check_plans import lines
    from peers import Arm
    from rules import expected_keyframes
    from solver_vs_drake import Drake, waypoint_times

    robot, arm = robots.robot("panda").model, Arm()
    drake = Drake() if options.drake else None
    folder = None if options.assets is None else check_assets(options.assets)
    raw = {entry["id"]: entry for entry in lines(options.problems)}
    free: list[tuple[float, float, float]] = []
    kept: list[tuple[float, float, float]] = []
    beside: list[tuple[float, float, float, float]] = []
    for problem in read_problems(options.problems)[:: options.every]:
        scene = problem_scene(problem, folder, robot.forward_kinematics(np.asarray(problem.q_current)))
        question = keypoint_problem(problem, scene, robot)
        plan = kpam.plan(question)
        if plan.status != "solved" or plan.trajectory is None or plan.q_plan is None:
            continue
        times = waypoint_times(raw[problem.id], plan.trajectory.times[-1])
        times = times[(times > plan.trajectory.times[0]) & (times < plan.trajectory.times[-1])]
        found, spent = refined(question, plan, times, False)
        free.append((found["cost_before"], found["cost_after"], spent))
        again, spent = refined(question, plan, times, True)
        kept.append((again["cost_before"], again["cost_after"], spent))
        if drake is not None and len(beside) < options.drake:
            keyframes = expected_keyframes(raw[problem.id], arm.hand_pose(plan.q_plan), "original")
            waypoints, milliseconds = drake.trajectory(raw[problem.id], plan.q_plan, keyframes)
            if waypoints is not None:
                beside.append((found["cost_before"], found["cost_after"], cost_of(waypoints), milliseconds))
    for label, rows in (("keyframes kept", free), ("hand paths from the actuation on kept", kept)):
        before, after, spent_ms = np.array(rows).T
        print(
            f"{label}: {len(rows)} plans, cost {np.median(before):.3f} before, {np.median(after):.3f} after (medians), "
            f"ratio {np.median(after / before):.3f}; CPU ms {np.median(spent_ms):.1f}, most {spent_ms.max():.1f}"
        )
    if beside:
        before, after, other, spent_ms = np.array(beside).T
        print(
            f"beside Drake: {len(beside)} problems, before {np.median(before / other):.3f} times its cost, after "
            f"{np.median(after / other):.3f} (most {(after / other).max():.3f}); Drake {np.median(spent_ms):.0f} ms"
        )
    return int(any(after > before for before, after, _ in free + kept))


if __name__ == "__main__":
    sys.exit(main())

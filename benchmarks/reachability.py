"""For each recorded problem: does an independent sampling planner, given 10 s of CPU, find the whole motion?

    python benchmarks/reachability.py --problems plans.jsonl --assets DIR --out reach.jsonl [--plans out.jsonl]

Random actuation poses that meet the constraints, the fixed lines and arcs followed from them by Newton steps, then
RRT-Connect from the start; Pinocchio and coal throughout, and every motion found is judged by the checker before it
counts. Goes on where an earlier run stopped. With ``--plans`` (output of ``gensim2 bench solver``) it prints who solves
what.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from check_plans import Finding, check_path, lines
from peers import Arm, scene_obstacles
from rules import Keyframe, expected_keyframes
from sampling import Stages, actuation_poses, between_poses, follow, rrt_connect

Array = np.ndarray


def plan_motion(
    problem: dict[str, Any], assets: Path, arm: Arm, frames: str, seconds: float, seed: int
) -> dict[str, Any]:
    """Search for one problem's whole motion.

    Returns:
        ``id``, ``found``, ``cpu_s``, how far the search came (``poses``: solutions of the constraints, ``followed``: of
        which the fixed paths are free), and ``times`` and ``path`` where found.
    """
    q_start = np.asarray(problem["q_current"], dtype=float)
    obstacles, _ = scene_obstacles(problem, assets, arm.hand_pose(q_start))
    stages = Stages(arm, obstacles, q_start)
    draw = np.random.default_rng(seed)
    begin = time.process_time()

    def late() -> bool:
        return time.process_time() - begin > seconds

    result: dict[str, Any] = {"id": problem["id"], "found": False, "poses": 0, "followed": 0, "rejected": 0}
    starts = 0
    for q_actuation in actuation_poses(problem, arm, draw):
        starts += 1
        if late():
            break
        if q_actuation is None:
            continue
        result["poses"] += 1
        keyframes = expected_keyframes(problem, arm.hand_pose(q_actuation), frames)
        fixed = fixed_motion(arm, stages, keyframes, q_actuation, problem)
        if fixed is None:
            continue
        result["followed"] += 1
        # Another pose may be easier to get to: half of what is left, but never less than a second.
        left = seconds - (time.process_time() - begin)
        stop = time.process_time() + max(1.0, 0.5 * left)
        has_pre = bool(problem["pre_actuation_times"])
        free = stages.free(stages.APPROACH if has_pre else stages.CONTACT)

        def give_up(stop: float = stop) -> bool:
            return late() or time.process_time() > stop

        approach = rrt_connect(arm, q_start, fixed[0][1], free, draw, give_up)
        if approach is None:
            continue
        times, path = timed(problem["start_time"], approach, fixed)
        finding = Finding(problem["id"], "solved")
        check_path(problem, times, path, "path", arm, obstacles, keyframes, finding)
        if finding.errors:
            result["rejected"] += 1
            result["last_error"] = finding.errors[0]
            continue
        result.update(found=True, times=times.tolist(), path=np.round(path, 9).tolist(), q_plan=q_actuation.tolist())
        break
    result["starts"] = starts
    result["cpu_s"] = round(time.process_time() - begin, 3)
    return result


def fixed_motion(
    arm: Arm, stages: Stages, keyframes: list[Keyframe], q_actuation: Array, problem: dict[str, Any]
) -> list[tuple[float, Array]] | None:
    """(time, joints) from the first keyframe to the last, through the actuation pose; None where it is not free."""
    index = next(i for i, frame in enumerate(keyframes) if frame.time == problem["actuation_time"])
    if not stages.free(stages.CONTACT)(q_actuation) and index > 0:
        # The arm may not lie in the moving link right before the actuation.
        return None
    if not stages.free(stages.MOTION)(q_actuation):
        return None
    before: list[tuple[float, Array]] = []
    q = q_actuation
    for later, earlier in zip(reversed(keyframes[1 : index + 1]), reversed(keyframes[:index]), strict=True):
        # Between the last two of these the hand may touch; further back it may not.
        stage = stages.CONTACT if later.time == problem["actuation_time"] else stages.APPROACH
        part = follow(arm, q, between_poses(later, earlier), stages.free(stage))
        if part is None:
            return None
        clock = np.linspace(later.time, earlier.time, len(part))
        before = [*reversed(list(zip(clock[1:], part[1:], strict=True))), *before]
        q = part[-1]
    if (
        index > 0
        and not stages.free(stages.APPROACH)(next(q for when, q in before if when == problem["pre_actuation_times"][0]))
        and index > 1
    ):
        return None
    after: list[tuple[float, Array]] = []
    q = q_actuation
    for earlier, later in zip(keyframes[index:], keyframes[index + 1 :], strict=False):
        part = follow(arm, q, between_poses(earlier, later), stages.free(stages.MOTION))
        if part is None:
            return None
        clock = np.linspace(earlier.time, later.time, len(part))
        after += list(zip(clock[1:], part[1:], strict=True))
        q = part[-1]
    return [*before, (float(problem["actuation_time"]), q_actuation), *after]


def timed(start_time: float, approach: list[Array], fixed: list[tuple[float, Array]]) -> tuple[Array, Array]:
    """Put the approach on the clock by its length and append the rest."""
    lengths = [float(np.abs(b - a).max()) for a, b in pairwise(approach)]
    shares = np.concatenate([[0.0], np.cumsum(lengths)]) / max(sum(lengths), 1e-12)
    clock = start_time + shares * (fixed[0][0] - start_time)
    times = np.concatenate([clock, [when for when, _ in fixed[1:]]])
    return times, np.array([*approach, *(q for _, q in fixed[1:])])


def print_summary(results: list[dict[str, Any]], plans: Path | None) -> None:
    """Counts, and with our own plans beside them who solves what."""
    found = {result["id"] for result in results if result["found"]}
    print(f"{'problems':40s} {len(results)}")
    print(f"{'whole motion found by sampling':40s} {len(found)}")
    print(f"{'no pose meets the constraints':40s} {sum(result['poses'] == 0 for result in results)}")
    print(f"{'fixed paths never free or in reach':40s} {sum(r['poses'] > 0 and r['followed'] == 0 for r in results)}")
    seconds = [result["cpu_s"] for result in results if result["found"]]
    if seconds:
        print(f"{'CPU seconds where found, median':40s} {np.median(seconds):.2f}")
    if plans is None:
        return
    seen = {result["id"] for result in results}
    ours = {plan["id"] for plan in lines(plans) if plan["status"] == "solved" and plan["id"] in seen}
    print(f"{'whole motion planned by gensim2':40s} {len(ours)}")
    print(f"{'both':40s} {len(ours & found)} ({100 * len(ours & found) / max(len(found), 1):.1f} % of sampling's)")
    for name, ids in (("sampling alone", found - ours), ("gensim2 alone", ours - found)):
        print(f"{name:40s} {len(ids)}")
        for each in sorted(ids):
            print(f"    {each}")


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=Path, required=True)
    parser.add_argument("--assets", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True, help="JSON Lines; an existing file is gone on with")
    parser.add_argument("--frames", choices=["original", "object"], default="original")
    parser.add_argument("--seconds", type=float, default=10.0, help="CPU seconds a problem")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--limit", type=int)
    parser.add_argument("--plans", type=Path, help="output of gensim2 bench solver, to compare with")
    options = parser.parse_args(arguments)
    problems = lines(options.problems)[: options.limit]
    results = lines(options.out) if options.out.exists() else []
    done = {result["id"] for result in results}
    arm = Arm()
    for index, problem in enumerate(problems):
        if problem["id"] in done:
            continue
        result = plan_motion(problem, options.assets, arm, options.frames, options.seconds, options.seed)
        results.append(result)
        with options.out.open("a") as stream:
            stream.write(json.dumps(result) + "\n")
        short = {key: value for key, value in result.items() if key not in ("times", "path", "q_plan")}
        print(f"{index + 1} of {len(problems)} {short}", file=sys.stderr, flush=True)
    print_summary(results, options.plans)
    return 0


if __name__ == "__main__":
    sys.exit(main())

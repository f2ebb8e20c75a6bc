"""Plan again at a fixed rate from a moving state, and go over to each new motion.

    python benchmarks/replan_stream.py [--minutes 10] [--rate 10] [--deadline-ms 20] [--seed 0] [--json OUT]

A Panda moves among boxes to one random pose after the other. Each tick plans anew from the state that the motion will
have a deadline later, and splices the new motion in there. Where planning takes longer (CPU time of its thread) the
tick is a miss and the old motion goes on. Prints arrivals, misses, times, and the greatest jumps at seams; ends
with 1 where a deadline was missed or a seam jumps by more than 1e-6. The goals are the same at any rate, so that a high
rate should arrive as often as a low one.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

import gensim2_kpam as kpam
from gensim2 import robots
from gensim2.core.seeding import rng

Array = np.ndarray
Q_START = np.array([0.0, -0.32, 0.0, -2.61799, 0.0, 2.23, 0.785398, 0.04, 0.04])
TOOL = {"tool_head": [0.0, 0.0, 0.105], "tool_tail": [0.0, 0.0, 0.075], "tool_side": [0.0, 0.053, 0.105]}
CONFIG = kpam.SolverConfig(
    {
        "constraint_list": [
            {
                "type": "point2point_constraint",
                "keypoint_name": "tool_head",
                "target_keypoint_name": "goal",
                "tolerance": 0.001,
            }
        ]
    }
)


def boxes(draw: np.random.Generator, count: int) -> list[kpam.Body]:
    """A table, and boxes that stand on it away from the arm."""
    pose = np.eye(4)
    pose[:3, 3] = [0.6, 0.0, -0.03]
    out = [kpam.Body("table", "table", [kpam.Shape.box([0.6, 0.6, 0.03])], pose)]
    for index in range(count):
        size = draw.uniform(0.02, 0.06, 3)
        pose = np.eye(4)
        pose[:3, 3] = [*(draw.uniform([0.35, -0.5], [0.75, 0.5])), size[2] + 0.001]
        out.append(kpam.Body(f"box{index}", "rigid", [kpam.Shape.box(size)], pose))
    return out


def question(robot: kpam.Robot, bodies: list[kpam.Body], q: Array, goal: Array) -> kpam.KeypointProblem:
    return kpam.KeypointProblem(
        robot, CONFIG, q, tool_keypoints=TOOL, object_keypoints={"goal": goal}, T_base_object=np.eye(4), bodies=bodies
    )


def run(minutes: float, rate: float, deadline: float, seed: int) -> dict[str, Any]:
    """Drive for so many minutes of simulated time."""
    robot = robots.robot("panda").model
    draw = rng(seed, "replan stream")
    bodies = boxes(draw, 8)
    now, spent, jumps = 0.0, [], np.zeros(3)
    counts = {"ticks": 0, "missed": 0, "not solved": 0, "solved without motion": 0, "goals": 0, "arrivals": 0}
    problem, former, motion = None, None, None
    while now < 60.0 * minutes:
        counts["ticks"] += 1
        seam = now + deadline
        idle = motion is None or seam >= motion.times[-1]
        if motion is None:
            state: tuple[Array, ...] = (Q_START, np.zeros(9), np.zeros(9))
        else:
            state = motion.sample(seam)
        if problem is None or idle:
            counts["arrivals"] += former is not None and idle
            goal = draw.uniform([0.35, -0.4, 0.15], [0.65, 0.4, 0.6])
            problem, former = question(robot, bodies, state[0], goal), None
            counts["goals"] += 1
        start = problem.with_start(state[0], state[1], seam, acceleration=state[2])
        plan = kpam.plan(start, warm_start=former)
        spent.append(plan.cpu_ms["total"])
        if plan.status != "solved":
            counts["not solved"] += 1
            problem = problem if motion is not None and not idle else None
        elif plan.trajectory is None:
            counts["solved without motion"] += 1
        elif spent[-1] > 1e3 * deadline:
            counts["missed"] += 1
        else:
            begins = plan.trajectory.sample(seam)
            jumps = np.maximum(jumps, [np.abs(a - b)[:7].max() for a, b in zip(begins, state, strict=True)])
            motion = plan.trajectory if motion is None else motion.splice(plan.trajectory, seam)
            former = plan
        now += 1.0 / rate
    return counts | {
        "CPU ms, median": float(np.median(spent)),
        "CPU ms, 99th percentile": float(np.percentile(spent, 99)),
        "CPU ms, longest": float(np.max(spent)),
        "jump of position": float(jumps[0]),
        "jump of velocity": float(jumps[1]),
        "jump of acceleration": float(jumps[2]),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--rate", type=float, default=10.0)
    parser.add_argument("--deadline-ms", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    figures = run(arguments.minutes, arguments.rate, 1e-3 * arguments.deadline_ms, arguments.seed)
    for name, value in figures.items():
        print(f"{name:28} {value:.3g}" if isinstance(value, float) else f"{name:28} {value}")
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n")
    jumps = max(figures[f"jump of {name}"] for name in ("position", "velocity", "acceleration"))
    return 1 if figures["missed"] or figures["solved without motion"] or jumps > 1e-6 else 0


if __name__ == "__main__":
    sys.exit(main())

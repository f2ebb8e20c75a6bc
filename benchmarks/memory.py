"""Test that memory does not grow over a million inverse kinematics queries and 20,000 plans in one process.

    python benchmarks/memory.py [--queries 1000000] [--plans 20000] [--reports 10]

The script prints the resident memory (MB) and, at the end, its growth after the first tenth of each part, when caches
are full. The exit code is 1 if the growth exceeds ``--max-growth`` MB.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import gensim2_kpam as kpam
from gensim2 import robots
from gensim2.core import seeding

Q_START = np.array([0.0, -0.32, 0.0, -2.61799, 0.0, 2.23, 0.785398, 0.04, 0.04])
TOOL = {"tool_head": [0.0, 0.0, 0.105], "tool_tail": [0.0, 0.0, 0.075]}
CONFIG: dict[str, Any] = {
    "constraint_list": [
        {
            "type": "point2point_constraint",
            "keypoint_name": "tool_head",
            "target_keypoint_name": "goal",
            "tolerance": 0.001,
        },
        {
            "type": "frame_axis_parallel",
            "axis_from_keypoint_name": "tool_tail",
            "axis_to_keypoint_name": "tool_head",
            "target_axis": [0, 0, -1],
            "target_axis_frame": "world",
            "target_inner_product": 1,
            "tolerance": 0.1,
        },
    ],
    "pre_actuation_motions": [["translate_z", -0.05]],
    "post_actuation_motions": ["move-up"],
}


def resident_mb() -> float:
    """Return the resident memory of this process, MB."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return float(line.split()[1]) / 1024.0
    raise RuntimeError("/proc/self/status names no VmRSS")


def problems(robot: kpam.Robot, count: int, options: kpam.Options) -> list[kpam.KeypointProblem]:
    """Return planning problems with goals near a block on a table; all problems share the obstacles."""
    draw = seeding.rng(0, "memory")
    table, block = np.eye(4), np.eye(4)
    table[:3, 3], block[:3, 3] = [0.6, 0.0, -0.025], [0.45, 0.25, 0.1]
    bodies = [
        kpam.Body("table", "table", [kpam.Shape.box([0.6, 0.6, 0.025])], table),
        kpam.Body("block", "rigid", [kpam.Shape.box([0.05, 0.05, 0.1])], block),
    ]
    found = []
    for _ in range(count):
        goal = draw.uniform([0.35, -0.35, 0.08], [0.6, 0.35, 0.35])
        found.append(
            kpam.KeypointProblem(
                robot,
                kpam.SolverConfig(CONFIG),
                Q_START,
                tool_keypoints=TOOL,
                object_keypoints={"goal": goal},
                T_base_object=np.eye(4),
                bodies=bodies,
                options=options,
            )
        )
    return found


def watch(name: str, count: int, reports: int, call: Callable[[int], object]) -> float:
    """Make ``count`` calls and print the memory at intervals; return its growth after the first tenth, MB."""
    settled = 0.0
    step = max(1, count // reports)
    for done in range(1, count + 1):
        call(done)
        if done == max(1, count // 10):
            settled = resident_mb()
        if done % step == 0 or done == count:
            print(f"{name:28s} {done:9d}   {resident_mb():8.1f} MB", flush=True)
    return resident_mb() - settled


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--queries", type=int, default=1_000_000, help="number of inverse kinematics queries")
    parser.add_argument("--plans", type=int, default=20_000)
    parser.add_argument("--reports", type=int, default=10, help="number of memory readings printed for each part")
    parser.add_argument("--max-growth", type=float, default=4.0, help="maximum allowed growth, MB")
    options = parser.parse_args(arguments)
    # Use few solver starts per query, so that a million queries take minutes. A leak would occur in every query anyway.
    panda = robots.robot("panda").model
    quick, whole = problems(panda, 50, {"num_seeds": 4, "num_refinements": 1}), problems(panda, 50, {})
    grown = {
        "inverse kinematics": watch(
            "inverse kinematics", options.queries, options.reports, lambda k: kpam.ik(quick[k % len(quick)], 1)
        ),
        "plans": watch("plans", options.plans, options.reports, lambda k: kpam.plan(whole[k % len(whole)])),
    }
    for name, megabytes in grown.items():
        print(f"{name:28s} grew by  {megabytes:8.1f} MB after the first tenth")
    return 1 if max(grown.values()) > options.max_growth else 0


if __name__ == "__main__":
    sys.exit(main())

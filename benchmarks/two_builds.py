"""Comparison of two builds of the solver on the same problems. Each in a process of its own, by turns, CPU time.

    python benchmarks/two_builds.py --other FOLDER (--motions FILE.jsonl | --plans FILE.jsonl [--assets DIR])
        [--repeats 3] [--every 1] [--json OUT]

FOLDER holds the other build's package ``gensim2_kpam``: a copy of ``python/gensim2_kpam`` made before. Problem by
problem both answer by turns, ``--repeats`` times; the median of each counts. Prints for both medians, 95th and 99th
percentiles of CPU milliseconds, statuses, and lengths and durations of what both solve, and the ratio of each. Both
processes share one core, so nothing runs beside either.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np


def motions(path: Path, every: int) -> Iterator[Any]:
    """Yield one callable a joint-to-joint problem, which plans it."""
    from gensim2.bench.motion import read_motion_problems, solve_motions

    for problem in read_motion_problems(path)[::every]:

        def answer(problem: Any = problem) -> dict[str, Any]:
            record = solve_motions([problem])[0]
            return {"id": problem.id, "ms": {"total": record["cpu_ms"]}} | {
                key: record[key] for key in ("status", "length", "duration", "checks")
            }

        yield answer


def plans(path: Path, assets: Path | None, every: int) -> Iterator[Any]:
    """Yield one callable a recorded problem, which plans it."""
    import gensim2_kpam as kpam
    from gensim2 import robots
    from gensim2.bench.problems import read_problems
    from gensim2.bench.scene import problem_scene
    from gensim2.bench.solver import keypoint_problem

    robot = robots.robot("panda").model
    for problem in read_problems(path)[::every]:
        scene = problem_scene(problem, assets, robot.forward_kinematics(np.asarray(problem.q_current)))
        question = keypoint_problem(problem, scene, robot, frames="original")

        def answer(question: Any = question, name: str = problem.id) -> dict[str, Any]:
            plan = kpam.plan(question)
            duration = None if plan.trajectory is None else plan.trajectory.duration
            return {"id": name, "ms": dict(plan.cpu_ms), "status": str(plan.status), "duration": duration} | {
                "length": plan.cost,
                "checks": None,
            }

        yield answer


def serve(arguments: argparse.Namespace) -> None:
    """Answer problem numbers on standard input."""
    if arguments.motions is not None:
        answers = list(motions(arguments.motions, arguments.every))
    else:
        answers = list(plans(arguments.plans, arguments.assets, arguments.every))
    print(len(answers), flush=True)
    for line in sys.stdin:
        print(json.dumps(answers[int(line)]()), flush=True)


class Build:
    """A process that answers with one build."""

    def __init__(self, folder: Path | None) -> None:
        path = os.environ.get("PYTHONPATH", "")
        here = {} if folder is None else {"PYTHONPATH": os.pathsep.join([str(folder), path])}
        command = [sys.executable, __file__, "--serve", *sys.argv[1:]]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=os.environ | here
        )
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.ask_at, self.told_at = self.process.stdin, self.process.stdout

    def count(self) -> int:
        """Number of problems, once it is ready."""
        return int(self.told_at.readline())

    def ask(self, number: int) -> dict[str, Any]:
        """Its answer to a problem."""
        self.ask_at.write(f"{number}\n")
        self.ask_at.flush()
        return dict(json.loads(self.told_at.readline()))


def figures(name: str, ours: list[float], theirs: list[float]) -> str:
    """One line: the percentiles of both, and their ratios."""
    out = f"{name:>10}"
    for share in (50, 95, 99):
        a, b = np.percentile(ours, share), np.percentile(theirs, share)
        out += f"   p{share}: {b:8.3f} -> {a:8.3f} ({a / b if b else float('nan'):.3f})"
    return out


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--other", type=Path, required=True)
    parser.add_argument("--motions", type=Path)
    parser.add_argument("--plans", type=Path)
    parser.add_argument("--assets", type=Path)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if (arguments.motions is None) == (arguments.plans is None):
        parser.error("give one of --motions and --plans")
    if arguments.serve:
        serve(arguments)
        return 0
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    both = [Build(None), Build(arguments.other)]
    counts = [build.count() for build in both]
    rows: list[list[dict[str, Any]]] = [[], []]
    for number in range(counts[0]):
        told: list[list[dict[str, Any]]] = [[], []]
        for turn in range(arguments.repeats):
            for k in (0, 1) if turn % 2 == 0 else (1, 0):
                told[k].append(both[k].ask(number))
        for k in (0, 1):
            last = told[k][-1]
            parts = {part: statistics.median(t["ms"][part] for t in told[k]) for part in last["ms"]}
            rows[k].append(last | {"ms": parts})
    for k, name in ((1, "other"), (0, "this")):
        print(f"{name:>10}   {dict(sorted(Counter(row['status'] for row in rows[k]).items()))}")
    for part in rows[0][0]["ms"]:
        print(figures(f"{part} ms", *([row["ms"][part] for row in rows[k]] for k in (0, 1))))
    for what in ("length", "duration"):
        pairs = [
            (a[what], b[what])
            for a, b in zip(*rows, strict=True)
            if a["status"] == b["status"] == "solved" and a[what] and b[what]
        ]
        if pairs:
            ratio = [a / b for a, b in pairs]
            print(
                f"{what:>10}   ratio: median {np.median(ratio):.4f}, mean {np.mean(ratio):.4f}, worst {max(ratio):.3f}"
            )
    if arguments.json is not None:
        arguments.json.write_text(json.dumps({"this": rows[0], "other": rows[1]}) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Every robot at two things: pulling a drawer open, and lifting what lies on the table.

    python benchmarks/robots.py [--robots panda fetch] [--tasks OpenDrawer] [--objects mug] [--episodes 20] [--seed 0]
                                [--workers 2] [--json OUT]

Tasks of the library run with their own strategies, whoever executes them, closed loop, on generated objects; the three
verdicts are those of docs/reference/episodes.md. Objects are lifted as in grasps.py: by the best-ranked grasp for
which a motion exists, held 10 cm higher for 2 s.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import grasps

from gensim2.core.processes import WorkerPool, enumerated
from gensim2.core.processes import results as run
from gensim2.robots import robot_names
from gensim2.rollout.config import EpisodeConfig
from gensim2.rollout.worker import PRELOAD, episode
from gensim2.scenes.config import SceneOptions
from gensim2.tasks.library import load_strategies, load_task

#: What holds less often than this is no use of a robot.
ENOUGH = 0.7


def do(robot: str, task: str, seed: int) -> dict[str, Any]:
    """One episode of a library task."""
    setting = EpisodeConfig(SceneOptions("builtin", robot=robot).with_task(load_task(task), "all"))
    return {"robot": robot, "what": task, **episode(setting, load_strategies(task), seed).to_dict()}


def lift(robot: str, name: str, seed: int, number: int) -> dict[str, Any]:
    """One grasp of a rigid object."""
    found = grasps.lift(robot, name, seed, number)
    return {"robot": robot, "what": f"lift {name}", "held": found["cause"] == "held", **found}


def _job(kind: str, *arguments: Any) -> dict[str, Any]:
    return do(*arguments) if kind == "do" else lift(*arguments)


def report(results: list[dict[str, Any]]) -> bool:
    """Print the table; whether everything holds often enough."""
    print("| robot | | held | paper | strict | what went wrong |\n|---|---|---|---|---|---|")
    enough = True
    for robot, what in dict.fromkeys((r["robot"], r["what"]) for r in results):
        mine = [r for r in results if (r["robot"], r["what"]) == (robot, what)]
        causes = Counter(str(r["cause"]) for r in mine if not r["held"])
        wrong = ", ".join(f"{count} {cause}" for cause, count in causes.most_common())
        held = sum(r["held"] for r in mine)
        verdicts = [
            f"{sum(r[name] for r in mine)}/{len(mine)}" if name in mine[0] else "" for name in ("paper", "strict")
        ]
        print(f"| {robot} | {what} | {grasps.interval(held, len(mine))} | {' | '.join(verdicts)} | {wrong} |")
        enough &= held >= ENOUGH * len(mine)
    return enough


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns 1 where something holds in less than 0.7."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", nargs="*", choices=robot_names(), default=list(robot_names()))
    parser.add_argument("--tasks", nargs="*", default=["OpenDrawer"])
    parser.add_argument("--objects", nargs="*", default=["mug"])
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    jobs: list[tuple[Any, ...]] = []
    for robot in options.robots:
        numbers = range(options.episodes)
        jobs += [("do", robot, task, options.seed + number) for task in options.tasks for number in numbers]
        jobs += [("lift", robot, name, options.seed, number) for name in options.objects for number in numbers]
    with WorkerPool(options.workers, preload=PRELOAD["sapien"]) as pool:
        found = {}
        for index, result in run(pool.map_unordered(_job, enumerated(jobs)), "episodes"):
            found[index] = result
            print(f"{len(found)} of {len(jobs)}: {result['robot']} {result['what']}", file=sys.stderr)
    results = [found[index] for index in sorted(found)]
    enough = report(results)
    if options.json:
        options.json.write_text(json.dumps(results, indent=1))
    return 0 if enough else 1


if __name__ == "__main__":
    sys.exit(main())

"""Plan random problems on six arms, and check every plan with independent code.

    python benchmarks/random_plans.py [--problems 20000] [--first 0] [--json OUT]

A Panda, an arm in the manner of Universal Robots', an xArm 7, a SCARA, a gantry and a mobile arm take turns, from rest
and under way, with and without something in the hand, among boxes and clouds. Every plan that is solved, whole or in
part, has a trajectory that Pinocchio's kinematics and coal's distances find within limits, clear by the margin,
beginning at the state given and ending at the goal (benchmarks/recheck.py); every other has none. Ends with 1 where one
is false.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

sys.path += [str(Path(__file__).parents[1] / folder) for folder in (".", "tests/common")]

from recheck import answer_of, recheck
from tests.kpam.random_problems import arm_problem
from tests.kpam.six_arms import ARMS

import gensim2_kpam as kpam


def wheel_robots() -> Path:
    """Return the folder of robots in ManiSkill's wheel."""
    spec = importlib.util.find_spec("mani_skill")
    if spec is None or not spec.submodule_search_locations:
        raise SystemExit("needs mani_skill, whose wheel holds the Panda and the xArm")
    return Path(next(iter(spec.submodule_search_locations))) / "assets" / "robots"


def errors_of(number: int, robots: Path, folder: Path) -> tuple[str, list[str]]:
    """Return the status of a random problem's plan, and the errors that other code finds in it."""
    problem = arm_problem(number, robots)
    plan = kpam.plan(problem.ours(folder))
    claims = plan.status in ("solved", "partial")
    if claims != (plan.trajectory is not None):
        return plan.status, [f"{plan.status}, and {'no' if claims else 'a'} trajectory"]
    return plan.status, recheck(problem.question(), answer_of(plan)).errors if claims else []


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=int, default=20_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    robots, begin = wheel_robots(), time.process_time()
    statuses: dict[str, Counter[str]] = {name: Counter() for name in ARMS}
    false: dict[int, list[str]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for number in range(arguments.first, arguments.first + arguments.problems):
            status, errors = errors_of(number, robots, Path(folder))
            statuses[ARMS[number % len(ARMS)]][status] += 1
            if errors:
                false[number] = errors
                print(f"problem {number} ({ARMS[number % len(ARMS)]}): {'; '.join(errors)}", flush=True)
    for name, counts in statuses.items():
        print(f"{name:10} " + ", ".join(f"{status} {count}" for status, count in counts.most_common()))
    solved = sum(counts["solved"] for counts in statuses.values())
    spent = time.process_time() - begin
    print(f"{arguments.problems} problems, {solved} solved, {len(false)} false; {spent:.0f} s of CPU")
    if arguments.json is not None:
        found = {"problems": arguments.problems, "first": arguments.first, "statuses": statuses, "false": false}
        arguments.json.write_text(json.dumps(found, indent=2) + "\n")
    return 1 if false else 0


if __name__ == "__main__":
    sys.exit(main())

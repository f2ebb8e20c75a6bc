"""Count how often the success criteria of tasks hold in worlds in which the task is not done.

    python benchmarks/checker.py --out checker.json [--worlds 100] [--seed 0] [--assets builtin] [TASK...]
    python benchmarks/checker.py --page checker.json      # writes docs/results/checker.md

Without names, all tasks of the package are measured: the tasks of the paper and of the offline designer. A task gets
scenes until the goal was judged in ``--worlds`` mutated worlds. A file that exists is continued.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from markdown_tables import line

from gensim2.core.files import write_atomic, write_json
from gensim2.core.seeding import scene_seeds
from gensim2.rollout.checker_result import DONE, LARGEST_ERROR, CheckerResult, Mutation, WorldCount, total
from gensim2.rollout.mutated import judge
from gensim2.rollout.tally import interval
from gensim2.scenes.initial_state import PlacementError
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.library import PAPER, load_task, packaged_names, task_names

PAGE = Path(__file__).parents[1] / "docs/results/checker.md"
MOST_SCENES = 100

INTRODUCTION = """This page reports how often the success criteria of a task are true although the task is not done. We
evaluated the criteria in mutated worlds. A mutated world is a successful end state in which one thing was changed so
that the task is not done ([kinds of worlds](../reference/tasks.md#mutated-worlds))."""

RECOGNIZED = """\
We also evaluated the criteria in the successful end states, where they must be true. This second test is needed,
because criteria that are never true are useless, although they make no errors in mutated worlds. If the object of a
scene does not fit into its container, the scene has no successful end state."""

BY_CRITERION = """\
The table lists for each type of criterion in how many mutated worlds it was tested, and in how many of these worlds the
result was wrong. A world counts for a criterion if the criterion is about the object that was changed in this world.
The task is not done in a mutated world, so the result is wrong if all criteria of the goal (or the step) are true."""

BY_TASK = """\
The table lists for each task the number of mutated worlds, and the number of these worlds in which the criteria were
wrongly true. If a task has only one step, the last column is empty, because the criteria of the step are the goal."""


def measure(name: str, worlds: int, seed: int, assets: str) -> dict[str, Any]:
    """Judge the mutated worlds of one task."""
    begin = time.process_time()
    env = HeadlessEnv(name, assets=assets)
    scenes: list[list[WorldCount]] = []
    for each in scene_seeds(seed, name, "checker", MOST_SCENES):
        try:
            scenes.append(judge(env, each))
        except PlacementError:
            continue
        if total(CheckerResult.of(scenes).of_goal)[1] >= worlds:
            break
    return {**CheckerResult.of(scenes).to_dict(), "cpu_s": round(time.process_time() - begin, 2)}


def page(found: dict[str, Any]) -> str:
    """Return the page of results."""
    results = {name: _result(fields) for name, fields in found["tasks"].items()}
    own = [result for name, result in results.items() if name in task_names(PAPER)]
    made = [result for name, result in results.items() if name not in task_names(PAPER)]
    every = [count for result in results.values() for count in result.counts]
    cpu_s = sum(fields["cpu_s"] for fields in found["tasks"].values())
    return "\n".join(
        [
            "# Results: errors of the success criteria",
            "",
            INTRODUCTION,
            "",
            f"    python benchmarks/checker.py --out checker.json --worlds {found['worlds']} --seed {found['seed']}"
            f" --assets {found['assets']}",
            "    python benchmarks/checker.py --page checker.json",
            "",
            f"The measurement took {cpu_s:.0f} s of CPU time ({cpu_s / len(results):.1f} s per task).",
            f"A task is refused if its goal is true in more than {LARGEST_ERROR:.0%} of its mutated worlds.",
            "",
            "## Tasks",
            "",
            *_table(
                [
                    "tasks",
                    "number",
                    "refused",
                    "goal: wrong / worlds",
                    "steps: wrong / worlds",
                    "end states recognized",
                ],
                [_row("the paper's", own), _row("the offline designer's", made), _row("all", [*own, *made])],
            ),
            "",
            RECOGNIZED,
            "",
            "## By criterion",
            "",
            BY_CRITERION,
            "",
            *_table(
                ["criterion", "in goals: wrong / worlds", "in steps: wrong / worlds"],
                [
                    [f"`{kind}`", _share(_of(every, kind, goal=True)), _share(_of(every, kind, goal=False))]
                    for kind in sorted({kind for count in every for kind in count.criteria})
                ],
            ),
            "",
            "## By kind of world",
            "",
            *_table(
                ["world", "goals: wrong / worlds", "steps: wrong / worlds"],
                [
                    [
                        str(mutation),
                        _share(total(c for c in every if c.mutation == mutation and c.step is None)),
                        _share(total(c for c in every if c.mutation == mutation and c.step is not None)),
                    ]
                    for mutation in Mutation
                ],
            ),
            "",
            "## By task",
            "",
            BY_TASK,
            "",
            *_table(
                ["task", "goal: wrong / worlds", "steps: wrong / worlds"],
                [[name, *_counts(result)] for name, result in results.items()],
            ),
        ]
    )


def _result(fields: dict[str, Any]) -> CheckerResult:
    counts = (WorldCount(**{**each, "criteria": tuple(each["criteria"])}) for each in fields["counts"])
    return CheckerResult(fields["scenes"], tuple(counts))


def _counts(result: CheckerResult) -> list[str]:
    steps = "{} / {}".format(*total(result.of_steps)) if result.of_steps else ""
    return ["{} / {}".format(*total(result.of_goal)), steps]


def _of(counts: Iterable[WorldCount], kind: str, goal: bool) -> tuple[int, int]:
    return total(c for c in counts if kind in c.criteria and (c.step is None) is goal and c.mutation != DONE)


def _row(name: str, results: list[CheckerResult]) -> list[str]:
    sums: dict[str, tuple[int, int]] = defaultdict(lambda: (0, 0))
    for result in results:
        for part, (wrong, worlds) in (
            ("goal", total(result.of_goal)),
            ("steps", total(result.of_steps)),
            ("done", result.recognized),
        ):
            sums[part] = (sums[part][0] + wrong, sums[part][1] + worlds)
    refused = sum(not result.passes for result in results)
    done = "{} / {}".format(*sums["done"])
    return [name, str(len(results)), str(refused), _share(sums["goal"]), _share(sums["steps"]), done]


def _share(found: tuple[int, int]) -> str:
    """Return a rate with its 95 % interval; an empty cell without worlds."""
    wrong, worlds = found
    if not worlds:
        return ""
    low, high = interval(wrong, worlds)
    return f"{wrong} / {worlds} ({100 * low:.2f}–{100 * high:.2f} %)"


def _table(head: list[str], rows: list[list[str]]) -> list[str]:
    return [line(head), line(["---"] * len(head)), *map(line, rows)]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="TASK", help="tasks (default: all tasks of the package)")
    parser.add_argument("--out", type=Path, help="file of the results")
    parser.add_argument("--page", type=Path, help="write the page from a file of results")
    parser.add_argument("--worlds", type=int, default=100, help="least number of mutated worlds of each task")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--assets", default="builtin")
    given = parser.parse_args()
    if given.page is not None:
        write_atomic(PAGE, page(json.loads(given.page.read_text(encoding="utf-8"))) + "\n")
        print(PAGE)
        return 0
    if given.out is None:
        parser.error("give --out or --page")
    found: dict[str, Any] = {"worlds": given.worlds, "seed": given.seed, "assets": given.assets, "tasks": {}}
    if given.out.exists():
        found["tasks"] = json.loads(given.out.read_text(encoding="utf-8"))["tasks"]
    for name in given.names or packaged_names():
        if name not in found["tasks"]:
            found["tasks"][load_task(name).name] = fields = measure(name, given.worlds, given.seed, given.assets)
            print(f"{name}: {fields['fooled']} of {fields['worlds']}, {fields['cpu_s']} s", flush=True)
            write_json(given.out, found)
    return int(any(not _result(fields).passes for fields in found["tasks"].values()))


if __name__ == "__main__":
    sys.exit(main())

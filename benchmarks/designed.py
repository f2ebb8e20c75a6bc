"""Store the tasks of an offline design run in the package, and write ``docs/results/designed.md``.

    gensim2 run-pipeline --from-empty --single 60 --long 60 --verify 50 --episodes 0 --videos 0 --assets builtin \
        --seed 7 --library none --out runs/designed
    python benchmarks/designed.py runs/designed

Without a folder, the script only rewrites the page from the tasks stored in the package.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any, get_args

from shelving import MADE_JSON, shelve

from gensim2.design.drafting import verbs
from gensim2.objects import open_library
from gensim2.objects.types import Kind
from gensim2.tasks.library import load_task_file
from gensim2.tasks.spec import TaskSpec

ROOT = Path(__file__).parents[1]
SHELF = ROOT / "python" / "gensim2" / "tasks" / "designed"
PAGE = ROOT / "docs/results/designed.md"

HEAD = """# Results: tasks of the offline designer

This page lists the tasks that the offline designer made with generated objects. The designer uses no language model.
It proposed tasks from the joints and sizes of objects, and combined tasks if one task prepares the scene for the next.
It searched strategies and verified each task ([architecture](../architecture.md)). Tasks that repeat a task of the
paper are not listed. This command measures the tasks:

    gensim2 benchmark --origin offline

The following design run started with an empty library:
"""


def main(arguments: list[str]) -> int:
    """Store the tasks of the given run, if any, in the package, and write the page."""
    if arguments:
        done = shelve(Path(arguments[0]), SHELF)
        print(f"{len(done.tasks)} tasks are stored in the package; left out: {', '.join(done.left_out) or 'none'}")
    tasks = [load_task_file(folder) for folder in sorted(SHELF.glob("*/")) if (folder / "task.yaml").is_file()]
    made = json.loads((SHELF / MADE_JSON).read_text(encoding="utf-8"))
    PAGE.write_text("\n".join([HEAD, *_made(made), *_summary(tasks), *_tables(tasks)]) + "\n", encoding="utf-8")
    print(PAGE)
    return 0


def _made(made: dict[str, Any]) -> list[str]:
    asked = made["arguments"]
    command = (
        f"gensim2 run-pipeline --from-empty --single {asked['single']} --long {asked['long']} "
        f"--verify {asked['verify']} --episodes 0 --videos 0 --assets {asked['assets']} "
        f"--seed {asked['seed']} --library none --out runs/designed"
    )
    cpu, wall = made["cpu_s"], made["wall_s"]
    return [
        "```",
        command,
        "python benchmarks/designed.py runs/designed",
        "```",
        "",
        f"The run designed and verified {made['tried']} proposals. It took {cpu / 60:.0f} minutes of CPU time "
        f"({cpu / made['tried']:.0f} s per proposal)\nand {wall / 60:.0f} minutes of wall time on two shared cores.",
        "",
    ]


def _summary(tasks: list[TaskSpec]) -> list[str]:
    library = open_library("builtin")
    long = [task for task in tasks if not task.is_single_step]
    kinds = {task.name: Counter(library.kind(each.asset_class) for each in task.objects.values()) for task in tasks}
    classes = {name for task in tasks for name in _classes(task)}
    chains = Counter(" - ".join(verbs(task)) for task in long)
    rows = [
        ("tasks of one step", len(tasks) - len(long)),
        ("tasks of several steps", len(long)),
        (
            "tasks of several steps with two articulated objects",
            sum(kinds[task.name]["articulated"] > 1 for task in long),
        ),
        ("classes of articulated objects", sum(library.kind(name) == "articulated" for name in classes)),
        ("classes of rigid objects", sum(library.kind(name) == "rigid" for name in classes)),
        ("different sequences of verbs in tasks of several steps", len(chains)),
    ]
    rigid = sum(kinds[task.name]["articulated"] == 0 for task in tasks)
    return [
        *_table(("", "count"), rows),
        "",
        f"{rigid} tasks use only rigid objects. A rigid class has only one object, so these tasks were verified in "
        "new poses.\nAll other tasks were verified on unseen objects, with a different object in each "
        "episode.",
        "",
        "## Objects per task",
        "",
        *_table(("objects", "one step", "several steps"), _types(tasks, kinds)),
        "",
    ]


def _types(tasks: list[TaskSpec], kinds: dict[str, Counter[Kind]]) -> list[tuple[object, ...]]:
    def told(count: Counter[Kind]) -> str:
        return " and ".join(f"{count[kind]} {kind}" for kind in get_args(Kind) if count[kind])

    single = Counter(told(kinds[task.name]) for task in tasks if task.is_single_step)
    long = Counter(told(kinds[task.name]) for task in tasks if not task.is_single_step)
    return [(kind, single[kind] or "", long[kind] or "") for kind in sorted(single | long)]


def _classes(task: TaskSpec) -> set[str]:
    return {each.asset_class for each in task.objects.values()}


def _tables(tasks: list[TaskSpec]) -> list[str]:
    found: list[str] = []
    for title, group in (
        ("One step", [task for task in tasks if task.is_single_step]),
        ("Several steps", [task for task in tasks if not task.is_single_step]),
    ):
        rows = []
        for task in group:
            told = task.provenance.verification if task.provenance is not None else None
            classes = ", ".join(dict.fromkeys(thing.asset_class for thing in task.objects.values()))
            figure = (
                "" if told is None else f"{told.held}/{told.episodes} ({told.interval[0]:.2f}–{told.interval[1]:.2f})"
            )
            rows.append((task.name, task.description, classes, figure))
        found += [f"## {title}", "", *_table(("task", "sentence", "classes", "held (95 %)"), rows), ""]
    return found


def _table(head: tuple[str, ...], rows: Iterable[tuple[object, ...]]) -> list[str]:
    return [
        f"| {' | '.join(head)} |",
        f"|{' --- |' * len(head)}",
        *(f"| {' | '.join(map(str, row))} |" for row in rows),
    ]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

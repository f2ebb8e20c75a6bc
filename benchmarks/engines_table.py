"""Create the tables of docs/results/engines.md, which compare the success rates in both physics engines.

    python benchmarks/engines_table.py FILE... --commit HASH            # stores runs of designed tasks or of a policy
    python benchmarks/results_table.py --into docs/results/engines.md   # writes the tables

Results of the paper's tasks come from the package, where ``benchmarks/figures.py`` stores them. Results of ``gensim2
benchmark --origin offline`` and ``gensim2 evaluate --checkpoint`` are stored in ``engines.json`` in this folder. A new
row replaces an older row with the same task, controller and engine.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Sequence
from math import sqrt
from pathlib import Path
from typing import Any

from markdown_tables import line, take_in
from results_claims import TYPES
from scipy.stats import fisher_exact

from gensim2.design.execution import KEEP_LONG, KEEP_THRESHOLD
from gensim2.rollout.tally import interval
from gensim2.scenes.physics import ENGINES
from gensim2.tasks.figures import Condition, Figure
from gensim2.tasks.library import load_task, task_names

FILE = Path(__file__).with_name("engines.json")
CHANCE = 0.05
"""p-value of Fisher's exact test below which two success rates count as different."""
NAMES = {"sapien": "SAPIEN", "mujoco": "MuJoCo"}

Count = tuple[int, int]
"""Number of successful episodes (verdict ``held``) and number of all episodes."""


def differs(one: Count, other: Count) -> float:
    """Return the p-value of Fisher's exact test that two rates are equal."""
    return float(fisher_exact([[held, of - held] for held, of in (one, other)]).pvalue)


def suite(rows: Sequence[Figure]) -> str:
    """Return tables of the paper's tasks: successful episodes in each engine, with the paper's protocol."""
    counts: dict[tuple[str, str, str], Count] = {}
    for row in rows:
        condition = row.condition
        plain = Condition(**{**condition.model_dump(), "engine": "sapien"}).is_plain
        if plain and condition.physics == "default":
            counts[row.task, condition.objects, condition.engine] = row.held, row.episodes
    head = ["task"]
    for objects in ("generated", "real"):
        head += [f"{objects}, {NAMES[engine]}" for engine in ENGINES] + ["p"]
    found = []
    for kind in TYPES:
        tasks = [name for name in task_names("paper") if load_task(name).is_single_step == (kind == TYPES[0])]
        lines = [line([f"{kind} task", *head[1:]]), line(["---"] * len(head))]
        columns: list[list[list[Count]]] = [[[], []], [[], []]]
        for task in tasks:
            cells = [task]
            for objects, place in zip(("generated", "real"), columns, strict=True):
                pair = [counts.get((task, objects, engine)) for engine in ENGINES]
                cells += _pair(pair)
                for count, column in zip(pair, place, strict=True):
                    column += [count] if count is not None else []
            lines.append(line(cells))
        means = [_mean(column) for place in columns for column in place]
        lines.append(line(["mean", means[0], means[1], "", means[2], means[3], ""]))
        found.append("\n".join(lines))
    return "\n\n".join(found) + "\n"


def designed(_: Sequence[Figure]) -> str:
    """Return a table of the designed tasks with different success rates, or kept in one engine only."""
    counts = _taken_in("chain")
    pairs = {}
    for name in task_names("offline"):
        provenance = load_task(name).provenance
        assert provenance is not None
        verified = provenance.verification
        assert verified is not None
        pairs[name] = [
            counts.get((name, "sapien"), (verified.held, verified.episodes)),
            counts.get((name, "mujoco")),
        ]
    known = {name: (one, other) for name, (one, other) in pairs.items() if one is not None and other is not None}
    kept = {name: [_is_kept(name, count) for count in pair] for name, pair in known.items()}
    first, second = (sum(each) for each in zip(*kept.values(), strict=True))
    said = (
        f"A task is kept if at least {KEEP_THRESHOLD:.0%} of its episodes succeed, or {KEEP_LONG:.0%} for a task of "
        f"several steps. Of {len(known)} measured tasks, {first} succeed in SAPIEN often enough to be kept, and "
        f"{second} succeed often enough in MuJoCo. The success rate over all episodes is "
        f"{_mean([one for one, _ in known.values()])} in SAPIEN and "
        f"{_mean([other for _, other in known.values()])} in MuJoCo."
    )
    rows = [
        line([name, *_pair(pair)])
        for name, pair in known.items()
        if differs(*pair) < CHANCE or len(set(kept[name])) > 1
    ]
    if not rows:
        return f"{said} No task would be kept in one engine only, and no task has significantly different rates.\n"
    said += " The table lists the tasks with significantly different rates, and tasks that only one engine would keep."
    return "\n".join([said, "", line(["task", "SAPIEN", "MuJoCo", "p"]), line(["---"] * 4), *rows]) + "\n"


def policy(_: Sequence[Figure]) -> str:
    """Return a table with the success rates of the package's keypose policy in both engines."""
    counts = _taken_in("policy")
    lines = [line(["task", "SAPIEN", "MuJoCo", "p"]), line(["---"] * 4)]
    columns: list[list[Count]] = [[], []]
    for name in sorted({task for task, _ in counts}):
        one, other = (counts.get((name, engine)) for engine in ENGINES)
        if one is None or other is None:
            continue
        lines.append(line([name, *_pair([one, other])]))
        for column, count in zip(columns, (one, other), strict=True):
            column.append(count)
    (first, of), (second, again) = (_sum(column) for column in columns)
    if of:
        rates = first / of, second / again
        half = 1.96 * sqrt(rates[0] * (1 - rates[0]) / of + rates[1] * (1 - rates[1]) / again)
        change = f"{100 * (rates[1] - rates[0]):+.1f} points (± {100 * half:.1f})"
        lines.append(line(["all", *(_mean(column) for column in columns), change]))
    return "\n".join(lines) + "\n"


def _pair(pair: Sequence[Count | None]) -> list[str]:
    one, other = pair
    cells = ["" if count is None else f"{count[0]}/{count[1]}" for count in pair]
    if one is None or other is None:
        return [*cells, ""]
    p_value = differs(one, other)
    return [*cells, f"**{p_value:.3f}**" if p_value < CHANCE else f"{p_value:.2f}"]


def _is_kept(task: str, count: Count) -> bool:
    """Return whether a designed task succeeds often enough to be kept."""
    return count[0] / count[1] >= (KEEP_THRESHOLD if load_task(task).is_single_step else KEEP_LONG)


def _sum(counts: Iterable[Count]) -> Count:
    found = list(counts)
    return sum(held for held, _ in found), sum(of for _, of in found)


def _mean(counts: Sequence[Count]) -> str:
    """Format the fraction of successful episodes with its 95 % interval."""
    held, of = _sum(counts)
    if not of:
        return ""
    low, high = interval(held, of)
    return f"{held / of:.3f} ({low:.3f}–{high:.3f})"


def _taken_in(controller: str) -> dict[tuple[str, str], Count]:
    rows = json.loads(FILE.read_text(encoding="utf-8"))["rows"] if FILE.exists() else []
    return {
        (row["task"], row["engine"]): (row["held"], row["episodes"]) for row in rows if row["controller"] == controller
    }


def rows_of(found: dict[str, Any], commit: str) -> list[dict[str, Any]]:
    """Return the rows to store from one JSON output of ``gensim2 benchmark`` or ``gensim2 evaluate``."""
    return [
        {
            "task": task["name"],
            "controller": "policy" if "controller" in found else "chain",
            "engine": found["arguments"]["engine"],
            "instances": found["arguments"]["instances"],
            "seed": found["arguments"]["seed"],
            "episodes": task["episodes"],
            "held": sum(record["held"] for record in task["records"]),
            "causes": task["causes"],
            "commit": commit,
        }
        for task in found["tasks"]
    ]


def main() -> int:
    """Store the results of the given runs."""
    take_in(__doc__, FILE, rows_of, ("task", "controller", "engine"))
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Write the table of policies that stop by themselves, from the JSON of `gensim2 evaluate --json FILE`.

    python benchmarks/stop_table.py GOAL.json CONTROLLER.json --commit HASH   # stores results, writes tables
    python benchmarks/stop_table.py                                           # writes tables of stored results

The two files are evaluations of the packaged policy on the same scenes, with ``--stop goal`` and with ``--stop
controller``. The results are stored in ``stops.json`` in this folder. The tables are in docs/results/own_stop.md
and README.md.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from markdown_tables import Row, fill, markdown_table, take_in

from gensim2.rollout.tally import interval

FIGURES = Path(__file__).with_name("stops.json")
ROOT = Path(__file__).parents[1]
PAGES = (ROOT / "docs/results/own_stop.md", ROOT / "README.md")
MARKED = re.compile(r"(<!-- stops: (\w+) -->\n).*?(<!-- /stops -->)", re.DOTALL)
STOPS = ("goal", "controller")


def rows_of(found: Mapping[str, Any], commit: str) -> list[Row]:
    """Return one row for each task of an evaluation.

    Raises:
        ValueError: another policy than the packaged one was evaluated.
    """
    checkpoint = str(found["controller"]["arguments"].get("checkpoint"))
    if Path(checkpoint).name != "builtin":
        raise ValueError(f"the evaluation is of {checkpoint}; evaluate with --checkpoint builtin")
    asked = found["arguments"]
    return [
        {
            "name": task["name"],
            **{name: asked[name] for name in ("stop", "seed", "engine", "instances", "randomization")},
            "episodes": task["episodes"],
            **{name: round(task[f"{name}_mean"] * task["episodes"]) for name in ("held", "strict")},
            "causes": task["causes"],
            "commit": commit,
        }
        for task in found["tasks"]
    ]


def table(rows: Sequence[Row]) -> str:
    """Return a table with one row per task: success rates with both ends of an episode."""
    head = ["task", "held, `--stop goal` (95 %)", "strict", "held, `--stop controller` (95 %)", "strict", "failures"]
    lines = []
    for name, both in {**_both(rows), "all": _all(rows)}.items():
        goal, own = (both[stop] for stop in STOPS)
        causes = ", ".join(f"{count} {cause}" for cause, count in own["causes"].items())
        lines.append([name, _rate(goal, "held"), _share(goal), _rate(own, "held"), _share(own), causes])
    return markdown_table(head, lines)


def short(rows: Sequence[Row]) -> str:
    """Return a sentence with the success rates over all tasks."""
    goal, own = (_all(rows)[stop] for stop in STOPS)
    return (
        f"On {len(_both(rows))} of these tasks, the packaged policy succeeds in {goal['held']} of {goal['episodes']} "
        f"episodes that end at the goal. If the policy itself must end the episode, it succeeds in {own['held']} of "
        f"{own['episodes']} ([table and command](docs/results/own_stop.md)).\n"
    )


def _both(rows: Sequence[Row]) -> dict[str, dict[str, Row]]:
    """Return the rows of each task by ``--stop``; tasks that were measured with only one are left out."""
    found: dict[str, dict[str, Row]] = {}
    for row in rows:
        found.setdefault(row["name"], {})[row["stop"]] = row
    return {name: both for name, both in found.items() if len(both) == len(STOPS)}


def _all(rows: Sequence[Row]) -> dict[str, Row]:
    """Return the sums over all tasks by ``--stop``."""
    total: dict[str, Row] = {stop: {"episodes": 0, "held": 0, "strict": 0, "causes": {}} for stop in STOPS}
    for both in _both(rows).values():
        for stop, row in both.items():
            for name in ("episodes", "held", "strict"):
                total[stop][name] += row[name]
            for cause, count in row["causes"].items():
                total[stop]["causes"][cause] = total[stop]["causes"].get(cause, 0) + count
    return total


def _rate(row: Row, name: str) -> str:
    low, high = interval(row[name], row["episodes"])
    return f"{row[name] / row['episodes']:.2f} ({low:.2f} to {high:.2f}) of {row['episodes']}"


def _share(row: Row) -> str:
    return f"{row['strict'] / row['episodes']:.2f}"


def main() -> None:
    """Store the results of evaluations, and write the tables."""
    rows = take_in(__doc__, FIGURES, rows_of, ("name", "stop"))
    fill(PAGES, MARKED, {"table": table, "short": short}, rows)


if __name__ == "__main__":
    main()

"""Do tasks hold as often on objects kept for the test as on those that configs were designed on? As Markdown.

    python benchmarks/train_and_test.py results/*.json > table.md

Each file is what `gensim2 benchmark --json FILE` wrote. Its episodes are divided by the first object that is acted on
and whose class has a test split: in that, or in the training split. Classes too small for a test split have none and
are named below the table. A cell is the share of episodes held, with its 95 % interval and the number of different
objects; the last line is the mean over the tasks that have both.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from statistics import mean
from typing import Any

from figures import rows_of

from gensim2.core.errors import InputError
from gensim2.objects import Library, open_library
from gensim2.rollout.tally import interval
from gensim2.tasks.library import load_task

SPLITS = ("train", "test")


def divided(library: Library, row: dict[str, Any]) -> tuple[str, dict[str, list[dict[str, Any]]]] | None:
    """The first object that a step of a task acts on and of whose class some are kept for tests: its role, and the
    episodes of each split; None where there is no such object, or a split has no episode."""
    task = load_task(row["name"])
    for role in (step.object for step in task.steps):
        try:
            ids = {split: set(library.choose(task.objects[role].asset_class, split)) for split in SPLITS}
        except InputError:
            continue
        if ids["train"].isdisjoint(ids["test"]):
            parts = {split: [e for e in row["records"] if e["objects"][role]["id"] in ids[split]] for split in SPLITS}
            return (role, parts) if all(parts.values()) else None
    return None


def cell(episodes: list[dict[str, Any]], role: str) -> str:
    """Share held with its interval, and how many objects."""
    held, objects = sum(each["held"] for each in episodes), {each["objects"][role]["id"] for each in episodes}
    low, high = interval(held, len(episodes))
    return f"{held / len(episodes):.3f} ({low:.2f}–{high:.2f}), {len(objects)} objects, {len(episodes)} episodes"


def table(path: Path) -> str:
    """The table of one file.

    Raises:
        InputError: it is no file of `gensim2 benchmark`.
    """
    rows_of(path)  # says what is wrong with a file
    document = json.loads(path.read_text(encoding="utf-8"))
    given = document["arguments"]
    library = open_library(given["assets"])
    objects = "generated" if given["assets"] == "builtin" else "real"
    lines = [
        f"{objects} objects, {given['physics']} physics, seed {given['seed']}",
        "",
        "| task | train | test |",
        "| --- | --- | --- |",
    ]
    rates: list[tuple[float, float]] = []
    unsplit = []
    for row in document["tasks"]:
        found = divided(library, row)
        if found is None:
            unsplit.append(row["name"])
            continue
        role, parts = found
        lines.append(f"| {row['name']} | {' | '.join(cell(parts[split], role) for split in SPLITS)} |")
        train, test = (mean(each["held"] for each in parts[split]) for split in SPLITS)
        rates.append((train, test))
    if rates:
        train, test = (mean(column) for column in zip(*rates, strict=True))
        lines.append(f"| mean of {len(rates)} | {train:.3f} | {test:.3f}, {100 * (test - train):+.1f} points |")
    if unsplit:
        lines.append(f"\nWithout a test split, all seen: {', '.join(unsplit)}.")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, nargs="+", help="JSON files of gensim2 benchmark")
    try:
        print("\n".join(table(path) for path in parser.parse_args().results))
    except InputError as error:
        sys.exit(f"train_and_test: {error}")


if __name__ == "__main__":
    main()

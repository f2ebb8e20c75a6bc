"""Write the tables of docs/results/generalization.md from the JSON of `gensim2 experiment NAME --json FILE`.

    python benchmarks/experiment_table.py FILE... --commit HASH   # stores the results, and writes the tables
    python benchmarks/experiment_table.py                         # writes the tables from the stored results

The results are stored in ``experiments.json`` in this folder, with the episode counts of each policy and task. A policy
replaces an earlier policy with the same name and first seed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from markdown_tables import markdown_table, take_in

from gensim2.core.files import write_atomic
from gensim2.policy.experiments.figures import KINDS, Kind, Rate, TaskFigures, summary
from gensim2.policy.experiments.page import WORDS

FIGURES = Path(__file__).with_name("experiments.json")
DOCS = Path(__file__).parents[1] / "docs"
PAGE = DOCS / "results" / "generalization.md"
CURVE = DOCS / "images" / "objects_curve.png"
MARKED = re.compile(r"(<!-- experiments -->\n).*?(<!-- /experiments -->)", re.DOTALL)
KEPT = ("name", "objects", "count", "demonstrations", "cpu_s")

Arm = dict[str, Any]


def arms_of(found: Mapping[str, Any], commit: str) -> list[Arm]:
    """Return the results of the policies of one run, without local file paths."""
    return [
        {
            **{name: arm[name] for name in KEPT},
            "seed": found["seed"],
            "seeds": len(arm["checkpoints"]),  # an unfinished run has fewer checkpoints than requested seeds
            "commit": commit,
            "tasks": {row["name"]: row["counts"] for row in found["tasks"] if row["arm"] == arm["name"]},
        }
        for arm in found["arms"]
    ]


def table(arms: Sequence[Arm]) -> str:
    """Return the table of success rates with one row per policy."""
    return _table("arm", [(arm["name"], _about(arm), list(arm["tasks"].values())) for arm in arms], ABOUT)


ABOUT = ["seed", "commit", "tasks", "trainings", "demonstrations", "CPU min", "seen minus unseen"]


def _about(arm: Arm) -> list[str]:
    told = summary(
        [
            TaskFigures(name, {kind: Rate(**rate) for kind, rate in counts.items()})
            for name, counts in arm["tasks"].items()
        ]
    )
    lost = ""
    if told["lost_mean"] is not None:  # the mean is over tasks that were measured both on seen and unseen objects
        gap, (low, high) = told["lost_mean"], told["lost_interval"]
        lost = f"{100 * gap:+.1f} ({100 * low:+.1f} to {100 * high:+.1f}) points"
    taught = sum(bool({"seen", "unseen"} & set(counts)) for counts in arm["tasks"].values())
    return [
        str(arm["seed"]),
        arm["commit"],
        str(taught),
        str(arm["seeds"]),
        str(arm["demonstrations"]),
        f"{arm['cpu_s'] / 60:.0f}",
        lost,
    ]


def _rate(tasks: Any, kind: Kind) -> Rate:
    return Rate.total([Rate(**counts[kind]) for counts in tasks if kind in counts])


def _table(what: str, rows: Sequence[tuple[str, list[str], list[Any]]], about: Sequence[str]) -> str:
    kinds = [kind for kind in KINDS if any(_rate(tasks, kind).episodes for _, _, tasks in rows)]
    head = [what, *(f"{WORDS[kind]} (95 %)" for kind in kinds), *about]
    lines = ([name, *(_cell(_rate(tasks, kind)) for kind in kinds), *cells] for name, cells, tasks in rows)
    return markdown_table(head, lines)


def _cell(rate: Rate) -> str:
    if rate.mean is None:
        return ""
    low, high = rate.interval
    return f"{rate.mean:.3f} ({low:.3f} to {high:.3f}) of {rate.episodes}"


def draw(arms: Sequence[Arm], file: Path) -> None:
    """Plot the success rates of the policies of ``scaling`` against the number of training objects."""
    from matplotlib.figure import Figure

    counted = sorted((arm for arm in arms if arm["name"] == f"objects-{arm['count']}"), key=lambda arm: arm["count"])
    figure = Figure(figsize=(6.4, 3.4), layout="constrained")
    axes = figure.subplots()
    kinds: tuple[tuple[Kind, str], ...] = (("unseen", "generated objects, unseen"), ("real", "real objects, unseen"))
    for kind, label in kinds:
        rates = [(arm["count"], _rate(arm["tasks"].values(), kind)) for arm in counted]
        points = [(count, rate.mean, *rate.interval) for count, rate in rates if rate.mean is not None]
        x, mean, low, high = zip(*points, strict=True)
        below, above = ([abs(a - b) for a, b in zip(mean, ends, strict=True)] for ends in (low, high))
        axes.errorbar(x, mean, yerr=(below, above), marker="o", capsize=3, label=label)
    axes.set(
        xscale="log", xlabel="generated objects of each class that taught", ylabel="held (95 %)", ylim=(0.7, 1.005)
    )
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right")
    figure.savefig(file, dpi=150)


def _natural(key: tuple[str, int]) -> tuple[list[tuple[int, str]], int]:
    """Return a sort key for names and seeds that orders the numbers in names by value."""
    name, seed = key
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)], seed


def main() -> None:
    """Store the results of runs, and write the tables."""
    arms = take_in(__doc__, FIGURES, arms_of, ("name", "seed"), field="arms", order=_natural)
    draw(arms, CURVE)
    write_atomic(PAGE, MARKED.sub(lambda match: f"{match[1]}{table(arms)}{match[2]}", PAGE.read_text()))


if __name__ == "__main__":
    main()

"""``gensim2 benchmark``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.output import line, report, table


@click.command("benchmark", cls=options.Command, short_help="Measure how often tasks succeed.")
@click.argument("tasks", nargs=-1)
@click.option("--runs", type=options.count(1000), default=5, show_default=True, help="Repetitions.")
@click.option(
    "--episodes",
    type=options.count(),
    default=50,
    show_default=True,
    help="Number of episodes of each task in each run.",
)
@options.origin
@options.library
@options.scenes
@click.option(
    "--attempts",
    type=options.count(100),
    default=1,
    show_default=True,
    help="Most attempts of an episode: from the same start with another strategy first and another seed of the solver, "
    "until one holds.",
)
@click.option(
    "--disturb",
    "disturbance",
    type=click.Choice(("push", "drop")),
    default=None,
    help="At a seeded moment of each episode push the object that is to be taken 3 cm aside, or open the fingers that "
    "hold it; tasks without such an object are left out.",
)
@click.option(
    "--method",
    type=click.Choice(("chain", "one-plan")),
    default="chain",
    show_default=True,
    help="chain: our strategies, a step planned again where something goes otherwise. one-plan: the paper's method "
    "with our solver, every step planned once, at its turn, by its first strategy.",
)
@options.out("Folder to write to.  [default: runs/<date>-<time>]")
@options.processes
@options.ray
@options.resume
@options.json_file
def benchmark(tasks: tuple[str, ...], json_file: str | None, **given: Any) -> None:
    """Run TASKS (the paper's suite, or all of --origin, where none is named) on random scenes, in the paper's protocol.

    Three verdicts stand beside each other: paper (what the paper counts), held (true at the end, at rest, and not in
    the no-op baseline) and strict, each with its 95 % interval. The JSON holds every episode, from which the table
    follows. Tasks for which these objects do not do are named and left out.
    """
    method = given.pop("method")
    with report(json_file, _show) as (progress, give):
        from gensim2.evaluation import benchmark as function

        give(function(tasks, one_plan=method == "one-plan", progress=progress, **given).to_dict())


def _show(result: dict[str, Any]) -> None:
    speeds = result["episodes_per_second"]
    rows = [
        (
            row["name"],
            row["episodes"],
            f"{row['success_mean']:.2f} ± {row['success_std']:.2f} {_interval(row, 'success')}",
            f"{row['held_mean']:.2f} {_interval(row, 'held')}",
            f"{row['strict_mean']:.2f} {_interval(row, 'strict')}",
            _figure(row["paper_figure"]),
            _figure(row["original_figure"]),
            f"{row['partial_share']:.2f}",
            row["replanned"],
            row["different_objects"],
            row["seen"] or "",
            _figure(speeds[row["name"]]),
            ", ".join(f"{count} {cause}" for cause, count in row["causes"].items()),
        )
        for row in result["tasks"]
    ]
    for group in result["groups"]:
        means = (f"{group[f'{name}_mean']:.2f} {_interval(group, name)}" for name in ("success", "held", "strict"))
        figures = (_figure(group["paper_figure"]), _figure(group["original_figure"]))
        rows.append((f"mean of {group['tasks']} {group['type']}", group["episodes"], *means, *figures, *[""] * 6))
    table(
        (
            "task",
            "episodes",
            "paper (95 %)",
            "held (95 %)",
            "strict (95 %)",
            "published",
            "original",
            "partial",
            "replanned",
            "objects",
            "seen",
            "episodes/s",
            "causes",
        ),
        rows,
    )
    for name, reason in result["skipped"].items():
        line(f"skipped {name}: {reason}")
    if result["arguments"]["disturbance"] is not None:
        for row in result["tasks"]:
            line(f"{row['name']}: disturbed in {row['disturbed']} of {row['episodes']} episodes")
    line(f"{result['cpu_s']:.1f} s of CPU; episodes: {Path(result['run_dir']) / 'tasks'}")


def _interval(row: dict[str, Any], verdict: str) -> str:
    low, high = row[f"{verdict}_interval"]
    return f"({low:.2f} to {high:.2f})"


def _figure(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"

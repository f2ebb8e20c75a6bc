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
@click.option("--episodes", type=options.count(), default=50, show_default=True, help="Of each task in each run.")
@options.seed
@options.assets
@options.instances
@options.physics
@options.randomization
@options.robot
@options.open_loop
@click.option(
    "--disturb",
    "disturbance",
    type=click.Choice(("push", "drop")),
    default=None,
    help="At a seeded moment of each episode push the object that is to be taken 3 cm aside, or open the fingers that "
    "hold it.",
)
@options.out("Folder to write to.  [default: runs/<date>-<time>]")
@options.workers
@options.time_limit
@options.jobs_per_worker
@options.resume
@options.json_file
def benchmark(tasks: tuple[str, ...], json_file: str | None, **given: Any) -> None:
    """Run TASKS (all of the library where none is named) on random scenes, in the paper's protocol.

    Three verdicts stand beside each other: paper (what the paper counts), held (true at the end, at rest, and not with
    a still arm) and strict. The JSON holds every episode, from which the table follows.
    """
    with report(json_file, _show) as (progress, give):
        from gensim2.pipeline import benchmark as function

        give(function(tasks, progress=progress, **given).to_dict())


def _show(result: dict[str, Any]) -> None:
    rows = []
    for row in result["tasks"]:
        low, high = row["held_interval"]
        published = row["paper_figure"]
        rows.append(
            (
                row["name"],
                row["episodes"],
                f"{row['success_mean']:.2f} ± {row['success_std']:.2f}",
                f"{row['held_mean']:.2f} ({low:.2f} to {high:.2f})",
                f"{row['strict_mean']:.2f}",
                "" if published is None else f"{published:.2f}",
                row["partial"],
                row["replanned"],
                sum(row["objects"].values()),
                ", ".join(f"{count} {cause}" for cause, count in row["causes"].items()),
            )
        )
    table(
        (
            "task",
            "episodes",
            "paper",
            "held (95 %)",
            "strict",
            "published",
            "partial",
            "replanned",
            "objects",
            "causes",
        ),
        rows,
    )
    for name, reason in result["skipped"].items():
        line(f"skipped {name}: {reason}")
    line(f"{result['cpu_s']:.1f} s of CPU; episodes: {Path(result['run_dir']) / 'tasks'}")

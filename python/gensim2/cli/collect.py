"""``gensim2 collect``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.output import line, report, table


@click.command("collect", cls=options.Command, short_help="Collect a data set of many tasks.")
@click.argument("tasks", nargs=-1)
@click.option(
    "--episodes", type=options.count(999_999_999), required=True, help="Number of episodes to try of each task."
)
@click.option("--out", type=click.Path(path_type=Path), required=True, metavar="DIR", help="Folder of the data set.")
@options.scenes
@click.option("--keep-failures", is_flag=True, help="Keep the states of episodes that do not hold, too.")
@click.option(
    "--noise",
    type=click.FloatRange(0, 0.2),
    default=0.0,
    show_default=True,
    metavar="RAD",
    help="Send the arm elsewhere now and then, by angles of this standard deviation; what was meant is kept as the "
    "label that `gensim2 train` learns.",
)
@click.option(
    "--strategy",
    multiple=True,
    metavar="NAME",
    help="Do a step that has it in no other way; may be given again, for other steps.",
)
@click.option(
    "--objects",
    type=options.count(100_000),
    default=None,
    help="Generated ones of each class to draw from, beyond those that are listed.  [default: those of --instances]",
)
@options.processes
@options.ray
@click.option("--resume", is_flag=True, help="Go on with the data set in --out, if there is one.")
@options.json_file
def collect(tasks: tuple[str, ...], json_file: str | None, **given: Any) -> None:
    """Try --episodes episodes of each of TASKS (all of the suite where none is named) and keep them.

    Every episode that was tried has its record; those that hold have their states and actions. What the folder holds at
    the end follows from the arguments alone, whatever happened on the way. With --resume it may get more --episodes and
    more TASKS. `gensim2 render` makes observations of it.
    """
    with report(json_file, _show) as (_, give):
        from gensim2.cli.collect_view import CollectionView
        from gensim2.data import collect as function

        with CollectionView() as view:
            give(function(tasks, listener=view, **given).to_dict())


def _show(result: dict[str, Any]) -> None:
    rows = [
        (
            task["name"],
            task["tried"],
            task["held"],
            task["strict"],
            ", ".join(f"{count} {cause}" for cause, count in task["causes"].items()),
        )
        for task in result["tasks"]
    ]
    table(("task", "episodes", "held", "strict", "causes"), rows)
    for name, reason in result["skipped"].items():
        line(f"skipped {name}: {reason}")
    rate = result["episodes_per_second"]
    speed = f", {rate:.2f} episodes a second" if rate is not None else ""
    line(f"{result['held']} of {result['episodes']} episodes hold; {result['bytes'] / 1e6:.1f} MB{speed}")
    line(f"report: {Path(result['folder']) / 'report.html'}")

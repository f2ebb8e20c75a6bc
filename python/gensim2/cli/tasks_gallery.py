"""``gensim2 tasks gallery``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.output import line, report


@click.command("gallery", cls=options.Command, short_help="Page with a film of every task.")
@click.argument("tasks", nargs=-1)
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True, metavar="DIR", help="The page.")
@options.origin
@options.library
@options.seed
@options.assets
@options.engine
@options.physics
@options.workers
@options.time_limit
@options.resume
@options.json_file
def gallery(tasks: tuple[str, ...], json_file: str | None, **given: Any) -> None:
    """Make a page that shows TASKS (the paper's suite, or all of --origin, where none is named).

    Of each task a picture, a short film of an episode that held, its sentence, its steps and its figures; of five
    random episodes the first that holds. What is finished stays: after Ctrl-C the same with --resume goes on.
    """
    with report(json_file, _show) as (progress, give):
        from gensim2.design import tasks_gallery as function

        give(function(tasks, progress=progress, **given).to_dict())


def _show(result: dict[str, Any]) -> None:
    for name, reason in result["skipped"].items():
        line(f"skipped {name}: {reason}")
    for name, cause in result["without"].items():
        line(f"{name}: no episode held, the last because of: {cause}")
    line(f"{len(result['shown'])} tasks shown: {result['index']}")

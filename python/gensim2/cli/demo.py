"""``gensim2 demo``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.main import FOUND_WRONG
from gensim2.cli.output import line, report


@click.command("demo", cls=options.Command, short_help="Record demonstrations of a task.")
@click.argument("task")
@click.option("--episodes", type=options.count(), default=5, show_default=True, help="Demonstrations to record.")
@options.library
@options.scenes
@options.out("Folder to write to.  [default: runs/<date>-<time>]")
@options.processes
@options.resume
@options.video
@options.json_file
@click.pass_context
def demo(ctx: click.Context, /, task: str, episodes: int, json_file: str | None, **given: Any) -> None:
    """Record demonstrations of TASK, a task of the library or a folder that holds task.yaml and strategies/.

    What counts is what holds at the end; --json tells of every verdict how many of the episodes that were run fulfil
    it, and the CPU seconds of all processes without their start. Ends with 1 where fewer demonstrations succeeded than
    were asked for.
    """
    with report(json_file, _show) as (progress, give):
        from gensim2.design import demo as function

        result = function(task, episodes=episodes, progress=progress, **given).to_dict()
        give(result)
    if result["demos"] < episodes:
        ctx.exit(FOUND_WRONG)


def _show(result: dict[str, Any]) -> None:
    line(f"{result['name']}: {result['demos']} demonstrations")
    verdicts = ", ".join(f"{result[name]} {name}" for name in ("paper", "held", "strict"))
    line(f"of {result['episodes_run']} episodes {verdicts}; {result['cpu_s']:.1f} s of CPU")
    for cause, count in result["causes"].items():
        line(f"{count} failed: {cause}")
    for note in result["notes"]:
        line(f"note: {note}")
    line(f"report: {Path(result['run_dir']) / 'report.html'}")

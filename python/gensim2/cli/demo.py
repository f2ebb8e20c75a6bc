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
@options.seed
@options.assets
@options.instances
@options.out("Folder to write to.  [default: runs/<date>-<time>]")
@options.workers
@options.time_limit
@options.jobs_per_worker
@options.resume
@options.video
@options.json_file
@click.pass_context
def demo(
    ctx: click.Context,
    task: str,
    episodes: int,
    seed: int,
    assets: str | None,
    instances: str,
    out: Path | None,
    workers: int,
    time_limit: float,
    jobs_per_worker: int,
    resume: bool,
    video: bool,
    json_file: str | None,
) -> None:
    """Record demonstrations of TASK, a task of the library or a folder that holds task.yaml and solver.yaml.

    Ends with 1 where fewer demonstrations succeeded than were asked for.
    """
    with report(json_file, _show) as (progress, give):
        from gensim2.pipeline import demo as function

        result = function(
            task,
            episodes=episodes,
            seed=seed,
            assets=assets,
            instances=instances,
            out=out,
            workers=workers,
            time_limit=time_limit,
            jobs_per_worker=jobs_per_worker,
            resume=resume,
            video=video,
            progress=progress,
        ).to_dict()
        give(result)
    if result["demos"] < episodes:
        ctx.exit(FOUND_WRONG)


def _show(result: dict[str, Any]) -> None:
    line(f"{result['name']}: {result['demos']} demonstrations")
    for note in result["notes"]:
        line(f"note: {note}")
    line(f"in {result['run_dir']}")

"""``gensim2 data``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.output import line, report, table

_FORMATS = click.Choice(("maniskill", "lerobot", "zarr"))
_FOLDER = click.Path(exists=True, file_okay=False, path_type=Path)


@click.group("data")
def data() -> None:
    """Look at data sets, and bring them to other tools."""


@data.command("export", cls=options.Command, short_help="Write a data set in another format.")
@click.argument("folder", type=_FOLDER)
@click.option("--to", type=_FORMATS, required=True, help="ManiSkill's HDF5, LeRobot v3.0, or zarr.")
@click.option("--out", type=click.Path(path_type=Path), required=True, metavar="DIR", help="Folder to write to.")
@click.option("--task", "tasks", multiple=True, metavar="TASK", help="Only this task; may be given several times.")
@click.option("--strict", is_flag=True, help="Only episodes that meet the strict verdict.")
@click.option("--whole", is_flag=True, help="Only episodes in which no part of a motion stood for the whole.")
@click.option("--first-try", is_flag=True, help="Only episodes in which nothing was planned again.")
@click.option("--min-steps", type=options.count(), default=1, show_default=True, help="Control steps at least.")
@click.option("--max-steps", type=options.count(), default=None, help="Control steps at most.")
@click.option(
    "--min-clearance",
    type=click.FloatRange(max=0.2),
    metavar="METRES",
    help="Metres that the robot keeps at least from the table, itself and objects that no step acts on; at most 0.2.",
)
@click.option("--observations/--no-observations", default=True, show_default=True, help="What `gensim2 render` made.")
@options.moved_assets
@options.json_file
def export(folder: Path, to: str, out: Path, json_file: str | None, **given: Any) -> None:
    """Write the episodes of the data set in FOLDER that held in another format.

    Beside frames, an export to LeRobot or zarr holds the episodes themselves, so that `gensim2 data import` gives them
    back. A card, README.md, says what the data are and how to read them.
    """
    with report(json_file, _show_count) as (progress, give):
        from gensim2.data.formats.export import export as function
        from gensim2.data.selection import Selection

        selection = Selection(
            tasks=given["tasks"],
            strict=given["strict"],
            whole=given["whole"],
            first_try=given["first_try"],
            shortest=given["min_steps"],
            longest=given["max_steps"],
            clearance=given["min_clearance"],
        )
        told = {"observations": given["observations"], "assets": given["assets"]}
        count = function(folder, out, to, selection, **told, progress=progress)  # type: ignore[arg-type]
        give({"schema_version": 1, "folder": str(out), "episodes": count})


@data.command("import", cls=options.Command, short_help="Make a data set of an export.")
@click.argument("folder", type=_FOLDER)
@click.option("--from", "of", type=_FORMATS, required=True, help="Format of FOLDER.")
@click.option("--out", type=click.Path(path_type=Path), required=True, metavar="DIR", help="Folder of the data set.")
@options.json_file
def import_(folder: Path, of: str, out: Path, json_file: str | None) -> None:
    """Make a data set of FOLDER, which `gensim2 data export` wrote: the same episodes, byte for byte."""
    with report(json_file, _show_count) as (progress, give):
        from gensim2.data.formats.importing import import_ as function

        count = function(folder, out, of, progress=progress)  # type: ignore[arg-type]
        give({"schema_version": 1, "folder": str(out), "episodes": count})


@data.command("report", cls=options.Command, short_help="What a data set covers, as a page.")
@click.argument("folder", type=_FOLDER)
@options.video
@options.moved_assets
@options.json_file
def quality(folder: Path, video: bool, assets: str | None, json_file: str | None) -> None:
    """Look at every episode of the data set in FOLDER and write FOLDER/quality.html.

    Where objects stood and how far open, which ones, how long and how smooth the motions are, how near the robot
    came to what it is not to touch, what is there twice, and a film of each task.
    """
    with report(json_file, _show_quality) as (progress, give):
        from gensim2.data.report import HTML
        from gensim2.data.report import report as function

        give({**function(folder, video=video, assets=assets, progress=progress), "report": str(folder / HTML)})


@data.command("card", cls=options.Command, short_help="Write a data set's README.md.")
@click.argument("folder", type=_FOLDER)
@options.json_file
def card(folder: Path, json_file: str | None) -> None:
    """Write FOLDER/README.md: what the data are, how they were made, whose terms they carry, how to read them."""
    with report(json_file, lambda result: line(result["card"])) as (_, give):
        from gensim2.data.card import card as function

        give({"schema_version": 1, "card": str(function(folder))})


def _show_count(result: dict[str, Any]) -> None:
    line(f"{result['episodes']} episodes in {result['folder']}")


def _show_quality(result: dict[str, Any]) -> None:
    rows = [
        (
            task["name"],
            f"{task['held']} of {task['tried']}",
            task["strict"],
            len(task["instances"]),
            "" if task["lengths"] is None else f"{task['lengths']['median']:.0f}",
            "" if task["jerks"] is None else f"{task['jerks']['median']:.1f}",
            "" if task["clearances"] is None else f"{1e3 * task['clearances']['median']:.0f}",
            task["same_scene"],
        )
        for task in result["tasks"]
    ]
    table(("task", "held", "strict", "objects", "steps", "jerk (rad/s3)", "clearance (mm)", "same scene"), rows)
    line(f"report: {result['report']}")

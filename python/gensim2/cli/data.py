"""Commands ``gensim2 data``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import click

from gensim2.cli.options import command
from gensim2.cli.output import line, table
from gensim2.cli.typed import Count, Folder, Option, Real, Tasks, count
from gensim2.core.plural import plural
from gensim2.core.progress import Progress

Format = Literal["maniskill", "lerobot", "zarr"]
Existing = Annotated[Path, click.Path(exists=True, file_okay=False, path_type=Path)]


def _show_count(result: dict[str, Any]) -> None:
    line(f"{plural(result['episodes'], 'episode')} in {result['folder']}")


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


@command("moved_assets", show=_show_count)
def export(
    folder: Existing,
    *,
    to: Format,
    out: Folder,
    tasks: Tasks = (),
    strict: bool = False,
    whole: bool = False,
    first_try: bool = False,
    min_steps: Count = 1,
    max_steps: Annotated[int | None, count()] = None,
    min_clearance: Annotated[float | None, Real(max=0.2), Option(metavar="METRES")] = None,
    observations: bool = True,
    progress: Progress,
    **given: Any,
) -> dict[str, Any]:
    """Export a data set to another format.

    The command exports the successful episodes of the data set in FOLDER. Exports to LeRobot and zarr also contain the
    original episode files, so that `gensim2 data import` can restore them. A README.md describes the data and how to
    read them.

    Args:
        to: Format: ManiSkill's HDF5, LeRobot v3.0, or zarr.
        out: Output folder.
        tasks: Export only this task; can be repeated.
        strict: Export only episodes that pass the strict verdict.
        whole: Export only episodes without partial motions.
        first_try: Export only episodes without replanning.
        min_steps: Minimum number of control steps.
        max_steps: Maximum number of control steps.
        min_clearance: Minimum distance, in metres, between the robot and the table, between two links of the robot, and
            between the robot and objects that the task does not use; at most 0.2.
        observations: Include the observations that `gensim2 render` made.
    """
    from gensim2.data.formats.export import export as function
    from gensim2.data.selection import Selection

    selection = Selection(
        tasks=tasks,
        strict=strict,
        whole=whole,
        first_try=first_try,
        shortest=min_steps,
        longest=max_steps,
        clearance=min_clearance,
    )
    written = function(folder, out, to, selection, observations=observations, progress=progress, **given)
    return {"schema_version": 1, "folder": str(out), "episodes": written}


@command(name="import", show=_show_count)
def import_(
    folder: Existing, *, of: Annotated[Format, Option("--from")], out: Folder, progress: Progress
) -> dict[str, Any]:
    """Restore a data set from an export.

    FOLDER is a folder that `gensim2 data export` wrote. The restored episodes are byte for byte the same as before the
    export. Rendered observations are not restored: use `gensim2 render` to add them again.

    Args:
        of: Format of FOLDER.
        out: Folder of the data set.
    """
    from gensim2.data.formats.importing import import_ as function

    written = function(folder, out, of, progress=progress)
    return {"schema_version": 1, "folder": str(out), "episodes": written}


@command("moved_assets", name="report", show=_show_quality)
def quality(folder: Existing, *, videos: int, progress: Progress, **given: Any) -> dict[str, Any]:
    """Write a page about the coverage and quality of a data set.

    The command reads every episode of the data set in FOLDER and writes FOLDER/quality.html. The page shows objects,
    placements, openness, length and smoothness of motions, the robot's clearance from other objects, duplicates, and
    videos of each task.
    """
    from gensim2.data.report import HTML
    from gensim2.data.report import report as function

    return {**function(folder, videos=videos, progress=progress, **given), "report": str(folder / HTML)}


@command(show=lambda result: line(result["card"]))
def card(folder: Existing) -> dict[str, Any]:
    """Write the README.md of a data set.

    The file describes the data, their origin, their licence, and how to read them.
    """
    from gensim2.data.card import card as function

    return {"schema_version": 1, "card": str(function(folder))}


data = click.Group(
    "data", commands=[export, import_, quality, card], help="Inspect data sets, and convert them for other tools."
)

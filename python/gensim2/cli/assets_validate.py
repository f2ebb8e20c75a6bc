"""``gensim2 assets validate`` and ``gensim2 assets prepare``."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.main import FOUND_WRONG
from gensim2.cli.output import line, report, table

_objects = click.argument("objects", nargs=-1, metavar="[CLASS[/WHICH]]...")
_every = click.option("--all", "every", is_flag=True, help="All of the library, which is what no CLASS means.")
_random = click.option(
    "--random",
    "drawn",
    type=options.count(),
    default=None,
    metavar="N",
    help="Also N more of each class, drawn by --seed: new numbers of generated objects, any of a folder's.",
)


@click.command("validate", cls=options.Command, short_help="Check objects in geometry and in physics.")
@_objects
@options.assets
@_every
@_random
@options.seed
@click.option("--physics/--no-physics", default=True, show_default=True, help="Simulate each object.")
@options.workers
@options.json_file
@click.pass_context
def validate(
    ctx: click.Context,
    objects: tuple[str, ...],
    assets: str | None,
    every: bool,
    drawn: int | None,
    seed: int,
    physics: bool,
    workers: int,
    json_file: str | None,
) -> None:
    """Check that objects are whole, stay where they are left, move as they should and can be reached.

    WHICH is an id, train, test, new, all or random. Prints one line an object; ends with 1 where one is not sound.
    """
    with report(json_file, _show) as (progress, give):
        from gensim2.objects import open_library
        from gensim2.objects.library.selection import select

        library = open_library(assets)
        items = select(library, objects, every=every, drawn=drawn or 0, seed=seed)
        from gensim2.inspection.validate import summary
        from gensim2.inspection.validate import validate as function

        started, reports = time.perf_counter(), []
        progress.start(f"checking objects of {library.name}", len(items))
        for each in function(library, items, physics, min(workers, len(items))):
            reports.append(each)
            progress.advance()
        result = {**summary(library, reports), "seconds": round(time.perf_counter() - started, 1)}
        give(result)
    if result["sound"] < len(reports):
        ctx.exit(FOUND_WRONG)


def _show(result: dict[str, Any]) -> None:
    for entry in result["objects"]:
        line(object_line(entry))
    if result["checks"]:
        table(("finding", "objects"), list(result["checks"].items()))
    line(f"{result['sound']} of {len(result['objects'])} objects of {result['library']} are sound")


def object_line(entry: dict[str, Any]) -> str:
    """One line about one validated object."""
    name = f"{entry['class']}/{entry['id']}"
    if entry["sound"]:
        return f"ok     {name}"
    return f"FAULT  {name}: " + "; ".join(f"{f['check']}: {f['value']} (limit {f['limit']})" for f in entry["findings"])


@click.command("prepare", cls=options.Command, short_help="Make objects now that are made at first use.")
@_objects
@options.assets
@_every
@options.seed
@options.workers
@options.json_file
@click.pass_context
def prepare(
    ctx: click.Context,
    objects: tuple[str, ...],
    assets: str | None,
    every: bool,
    seed: int,
    workers: int,
    json_file: str | None,
) -> None:
    """Take real objects apart into convex parts, or generate objects, and keep them in the cache.

    Any command does so when it first needs an object; this one does it ahead of time, and shows how far it is.
    Ends with 1 where one cannot be used.
    """
    with report(json_file, _show_prepared) as (progress, give):
        from gensim2.core.files import cache_dir
        from gensim2.objects import open_library
        from gensim2.objects.library.selection import select

        library = open_library(assets)
        items = select(library, objects, every=every, seed=seed)
        from gensim2.objects.library.loading import load_all

        progress.start(f"preparing objects of {library.name}", len(items))
        refused = []
        for item, reason in load_all(library, items, min(workers, len(items))):
            if reason is not None:
                refused.append({"class": item[0], "id": item[1], "reason": reason})
            progress.advance()
        give(
            {
                "schema_version": 1,
                "library": library.name,
                "prepared": len(items) - len(refused),
                "refused": refused,
                "cache": str(Path(cache_dir())),
            }
        )
    if refused:
        ctx.exit(FOUND_WRONG)


def _show_prepared(result: dict[str, Any]) -> None:
    for entry in result["refused"]:
        line(f"{entry['class']}/{entry['id']}: {entry['reason']}")
    line(f"{result['prepared']} objects of {result['library']} lie ready in {result['cache']}")

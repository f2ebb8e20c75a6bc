"""``gensim2 assets export`` and ``gensim2 assets import``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.output import line, report

_out = click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    metavar="LIBRARY",
    help="Folder of objects, which --assets takes; made where it is not there.",
)
_force = click.option("--force", is_flag=True, help="Replace objects that are there already.")


@click.command("export", cls=options.TaskCommand, short_help="Write objects as URDF, meshes and info.json.")
@click.argument("objects", nargs=-1, metavar="[CLASS[/WHICH]]...")
@options.assets
@click.option("--all", "every", is_flag=True, help="All of the library.")
@_out
@_force
@options.seed
@options.json_file
def export(
    objects: tuple[str, ...],
    assets: str | None,
    every: bool,
    out: Path,
    force: bool,
    seed: int,
    json_file: str | None,
) -> None:
    """Write objects in the layout of the GenSim2 release, which other tools load.

    WHICH is an id, train, test, all or random. Each object becomes articulated_objs/CLASS/ID in LIBRARY with
    mobility.urdf, textured_objs/ and info.json, in metres.
    """
    if not objects and not every:
        raise click.UsageError("name a CLASS or CLASS/ID, or say --all")
    with report(json_file, _show_exported) as (progress, give):
        from gensim2.assets import open_library
        from gensim2.assets.export import export as function
        from gensim2.assets.selection import select

        library = open_library(assets)
        items = select(library, objects, every=every, seed=seed)
        progress.start(f"exporting objects of {library.name}", len(items))
        written = []
        for asset_class, instance_id in items:
            instance = library.load(asset_class, instance_id)
            written.append(
                {
                    "class": asset_class,
                    "id": instance_id,
                    "folder": str(function(instance, out, force)),
                    "license": instance.license,
                }
            )
            progress.advance()
        give({"schema_version": 1, "library": str(out), "objects": written})


def _show_exported(result: dict[str, Any]) -> None:
    for entry in result["objects"]:
        line(entry["folder"])
    for terms in sorted({entry["license"] for entry in result["objects"]}):
        line(f"license: {terms}")

"""``gensim2 assets export`` and ``gensim2 assets import``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.assets_validate import object_line
from gensim2.cli.main import FOUND_WRONG
from gensim2.cli.output import line, report

_out = click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    metavar="LIBRARY",
    help="Folder of objects, which --assets takes; made where it is not there.",
)
_force = click.option("--force", is_flag=True, help="Replace objects that are there already.")


@click.command("export", cls=options.Command, short_help="Write objects as URDF, meshes and info.json.")
@click.argument("objects", nargs=-1, metavar="[CLASS[/WHICH]]...")
@options.assets
@click.option("--all", "every", is_flag=True, help="All articulated objects of the library.")
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
    """Write articulated objects in the layout of the GenSim2 release, which other tools load.

    WHICH is an id, train, test, new, all or random. Each object becomes articulated_objs/CLASS/ID in LIBRARY with
    mobility.urdf, textured_objs/ and info.json, in metres.
    """
    if not objects and not every:
        raise click.UsageError("name a CLASS or CLASS/ID, or say --all")
    with report(json_file, _show_exported) as (progress, give):
        from gensim2.objects import open_library
        from gensim2.objects.library.selection import select

        library = open_library(assets)
        items = select(library, objects, every=every, seed=seed, kind="articulated")
        from gensim2.objects.library.export import export as function

        progress.start(f"exporting objects of {library.name}", len(items))
        written = []
        for asset_class, instance_id in items:
            instance = library.load_articulated(asset_class, instance_id)
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


class _Scale(click.ParamType[float | str]):
    """``auto`` or a positive number."""

    name = "scale"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float | str:
        """Read it."""
        if value == "auto":
            return "auto"
        try:
            number = float(value)
        except (TypeError, ValueError):
            number = math.nan
        if not (math.isfinite(number) and number > 0):
            self.fail(f"{value!r} is neither 'auto' nor a positive number", param, ctx)
        return number


@click.command("import", cls=options.Command, short_help="Make an object of a PartNet-Mobility folder.")
@click.argument("source", metavar="DIR")
@click.option("--class", "asset_class", required=True, metavar="CLASS", help="Class of the new object.")
@click.option("--name", required=True, metavar="ID", help="Its id.")
@click.option("--joint", metavar="JOINT", help="The joint that stays.  [default: the only one of the class's type]")
@click.option(
    "--scale", type=_Scale(), default="auto", show_default=True, metavar="S|auto", help="Metres a unit of the model."
)
@click.option("--license", metavar="TEXT", default="unstated", show_default=True, help="Terms of the model.")
@_out
@_force
@options.json_file
@click.pass_context
def import_(
    ctx: click.Context,
    source: str,
    asset_class: str,
    name: str,
    joint: str | None,
    scale: Any,
    license: str,
    out: Path,
    force: bool,
    json_file: str | None,
) -> None:
    """Make an object of a PartNet-Mobility folder, or of the number of one that ManiSkill has downloaded.

    Fixes all joints but one, scales, proposes keypoints from the moving link's geometry, and checks the result.
    Edit info.json in the new folder and run `gensim2 assets validate CLASS/ID --assets LIBRARY` where the proposal
    does not suit. Ends with 1 where the object is not sound.
    """
    with report(json_file, _show_imported) as (progress, give):
        from gensim2.objects import open_library
        from gensim2.objects.library.sources import find_source

        folder = find_source(source)
        from gensim2.inspection.validate import check_object
        from gensim2.objects.library.importer import import_object  # brings SciPy: after what can be refused

        imported = import_object(
            folder, out, asset_class, name, joint=joint, scale=scale, license=license, replace=force
        )
        progress.start(f"taking {asset_class}/{name} apart and checking it", 1)
        checked = check_object(open_library(out), asset_class, name)
        progress.advance()
        give({"schema_version": 1, **imported.to_dict(), "object": checked.to_dict()})
    if not checked.sound:
        ctx.exit(FOUND_WRONG)


def _show_imported(result: dict[str, Any]) -> None:
    for note in result["notes"]:
        line(f"note: {note}")
    fixed = f", fixed {', '.join(result['fixed'])}" if result["fixed"] else ""
    line(f"moves at {result['joint']}{fixed}; scale {result['scale']:g}")
    line(object_line(result["object"]))
    line(f"edit {Path(result['folder']) / 'info.json'} to change keypoints, scale or range")


def _show_exported(result: dict[str, Any]) -> None:
    for entry in result["objects"]:
        line(entry["folder"])
    for terms in sorted({entry["license"] for entry in result["objects"]}):
        line(f"license: {terms}")

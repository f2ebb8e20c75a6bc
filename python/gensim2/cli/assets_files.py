"""Commands ``gensim2 assets export`` and ``gensim2 assets import``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import click

from gensim2.cli.assets_validate import Every, Objects, object_line
from gensim2.cli.options import Ending, command
from gensim2.cli.output import line
from gensim2.cli.typed import Option
from gensim2.core.progress import Progress

Library = Annotated[Path, click.Path(path_type=Path, file_okay=False), Option(metavar="LIBRARY")]


class _Scale(click.ParamType[float | str]):
    """Parameter type: ``auto`` or a positive number."""

    name = "scale"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float | str:
        """Return the number or ``auto``."""
        if value == "auto":
            return "auto"
        try:
            number = float(value)
        except (TypeError, ValueError):
            number = math.nan
        if not (math.isfinite(number) and number > 0):
            self.fail(f"{value!r} is neither 'auto' nor a positive number", param, ctx)
        return number


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


@command(show=_show_exported)
def export(
    objects: Objects = (),
    *,
    assets: str | None,
    every: Every = False,
    out: Library,
    force: bool = False,
    seed: int,
    progress: Progress,
) -> dict[str, Any]:
    """Export articulated objects as URDF, meshes and info.json.

    The layout is that of the GenSim2 release, which other tools can load: folder articulated_objs/CLASS/ID in LIBRARY,
    with mobility.urdf, textured_objs/ and info.json, in metres. WHICH is an id, train, test, new, all or random.

    Args:
        every: Export all articulated objects of the library.
        out: Output folder, usable as --assets; created if missing.
        force: Replace existing objects.
    """
    if not objects and not every:
        raise click.UsageError("name a CLASS or CLASS/ID, or say --all")
    from gensim2.objects import open_library
    from gensim2.objects.library.selection import select

    library = open_library(assets)
    items = select(library, objects, every=every, seed=seed, kind="articulated")
    from gensim2.objects.library.export import export as function

    progress.start(f"exporting objects of {library.name}", len(items))
    written = []
    for asset_class, instance_id in items:
        instance = library.load_articulated(asset_class, instance_id)
        folder = str(function(instance, out, force))
        written.append({"class": asset_class, "id": instance_id, "folder": folder, "license": instance.license})
        progress.advance()
    return {"schema_version": 1, "library": str(out), "objects": written}


@command(name="import", show=_show_imported)
def import_(
    source: Annotated[str, Option(metavar="DIR")],
    *,
    asset_class: Annotated[str, Option("--class", "CLASS")],
    name: Annotated[str, Option(metavar="ID")],
    joint: Annotated[str | None, Option(metavar="JOINT")] = None,
    scale: Annotated[Any, _Scale(), Option(metavar="S|auto")] = "auto",
    license: Annotated[str, Option(metavar="TEXT")] = "unstated",
    out: Library,
    force: bool = False,
    progress: Progress,
) -> dict[str, Any] | Ending:
    """Import an object from a PartNet-Mobility folder.

    DIR is the folder, or the number of a model that ManiSkill has downloaded. The import fixes all joints but one,
    scales the model, proposes keypoints from the geometry of the moving link, and checks the result. To change the
    proposed keypoints, edit info.json in the new folder and run `gensim2 assets validate CLASS/ID --assets LIBRARY`.
    The exit code is 1 if the object fails a check.

    Args:
        asset_class: Class of the new object.
        name: Id of the new object.
        joint: Joint that stays movable.  [default: the only one of the class's joint type]
        scale: Length in metres of one unit of the model.
        license: Licence of the model.
        out: Output folder, usable as --assets; created if missing.
        force: Replace existing objects.
    """
    from gensim2.objects import open_library
    from gensim2.objects.library.folder import find_source

    folder = find_source(source)
    from gensim2.inspection.validate import check_object  # imports SciPy, so bad input is refused first
    from gensim2.objects.library.importer import import_object

    imported = import_object(folder, out, asset_class, name, joint=joint, scale=scale, license=license, replace=force)
    progress.start(f"taking {asset_class}/{name} apart and checking it", 1)
    checked = check_object(open_library(out), asset_class, name)
    progress.advance()
    result = {"schema_version": 1, **imported.to_dict(), "object": checked.to_dict()}
    return result if checked.sound else Ending(result)

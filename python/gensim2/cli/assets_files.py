"""Commands ``gensim2 assets export`` and ``gensim2 assets import``."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import click

from gensim2.cli.assets_validate import Every, Objects, object_line
from gensim2.cli.options import Ending, command
from gensim2.cli.output import line
from gensim2.cli.typed import Option
from gensim2.core.errors import InputError
from gensim2.core.files import write_atomic
from gensim2.core.progress import Progress

if TYPE_CHECKING:
    from gensim2.objects import Library as LibraryObjects

PICTURE_SIZE = 360
"""Width and height of a view in the picture of an imported object, pixels."""
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
    if not result["simulated"]:
        line("note: only the geometry was checked, because SAPIEN is not installed (pip install 'gensim2[sim]')")
    if result["picture"] is not None:
        line(f"picture: {result['picture']}")
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
    to: Literal["urdf", "mjcf"] = "urdf",
    out: Library,
    force: bool = False,
    seed: int,
    progress: Progress,
) -> dict[str, Any]:
    """Write objects as URDF or MJCF.

    WHICH selects objects of the class CLASS: give an id, train, test, new, all or random.

    With --to urdf, the command writes articulated objects in the layout of the GenSim2 release. The folder
    LIBRARY/articulated_objs/CLASS/ID then contains mobility.urdf, textured_objs/ and info.json, with lengths in metres.
    With --to mjcf, the command writes articulated and rigid objects to the files LIBRARY/CLASS/ID.xml. Each file
    contains one object on a table, and python -m mujoco.viewer can show the file.

    Args:
        every: Export all articulated objects of the library.
        to: File format; mjcf needs the extra gensim2[mujoco].
        out: Output folder, usable as --assets; created if missing.
        force: Replace existing objects.
    """
    if not objects and not every:
        raise click.UsageError("give a CLASS or CLASS/ID, or add --all")
    from gensim2.objects import open_library
    from gensim2.objects.library.selection import select

    library = open_library(assets)
    if to == "mjcf":
        return _to_mjcf(library, select(library, objects, every=every, seed=seed), out, force)
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


def _to_mjcf(library: LibraryObjects, items: list[tuple[str, str]], out: Path, force: bool) -> dict[str, Any]:
    from gensim2.sim.mujoco.mjcf import write_object

    written = []
    for asset_class, instance_id in items:
        file = out / asset_class / f"{instance_id}.xml"
        if file.exists() and not force:
            raise InputError("exists already", file=file, field="--out", remedy="give --force to replace it")
        model = library.load(asset_class, instance_id)
        write_object(model, file)
        written.append({"class": asset_class, "id": instance_id, "folder": str(file), "license": model.license})
    return {"schema_version": 1, "library": str(out), "objects": written}


@command(name="import", show=_show_imported)
def import_(
    source: Annotated[str, Option(metavar="FILE|DIR")],
    *,
    asset_class: Annotated[str, Option("--class", "CLASS")],
    name: Annotated[str, Option(metavar="ID")],
    joint: Annotated[str | None, Option(metavar="JOINT")] = None,
    scale: Annotated[Any, _Scale(), Option(metavar="S|auto")] = "auto",
    up: Literal["y", "z"] = "z",
    keypoints: Annotated[tuple[str, ...], Option("--keypoint", "NAME=X,Y,Z|FILE")] = (),
    like: Annotated[str | None, Option(metavar="ID")] = None,
    license: Annotated[str, Option(metavar="TEXT")] = "unstated",
    out: Library,
    force: bool = False,
    progress: Progress,
) -> dict[str, Any] | Ending:
    """Import an object from a URDF, MJCF or USD file, or from a PartNet-Mobility folder.

    FILE is a .urdf, .xml, .mjcf, .usd, .usda, .usdc or .usdz file whose shapes are boxes, cylinders, spheres, capsules
    or meshes. MJCF files need the extra gensim2[mujoco], and USD files need the extra gensim2[usd]. DIR is a folder
    with mobility.urdf, or the number of a model that ManiSkill has downloaded.

    The command keeps one joint movable and fixes the other joints. It scales the model, proposes keypoints from the
    geometry of the moving link, checks the new object and draws the keypoints. To change the proposed keypoints, give
    --keypoint, or edit info.json in the new folder and run `gensim2 assets validate CLASS/ID --assets LIBRARY`. The
    exit code is 1 if the object fails a check.

    Args:
        asset_class: Class of the new object.
        name: Id of the new object.
        joint: Joint that stays movable.  [default: the only joint that has the class's joint type]
        scale: Length in metres of one unit of the model.
        up: Axis of the model that points up. If the axis is z, the front of the model must face -x. If the axis is y,
            the front must face z. A USD file itself states which axis points up.
        keypoints: Position of a keypoint such as head or tail in the frame of the moving link, in units of the model;
            can be repeated. FILE is a YAML file with the name and position of each keypoint.  [default: proposed from
            the geometry]
        like: Object of the class in LIBRARY whose keypoints replace the proposed keypoints. Each keypoint is placed at
            the same position relative to the bounding box of its link.
        license: Licence of the model.
        out: Output folder, usable as --assets; created if missing.
        force: Replace existing objects.
    """
    from gensim2.objects import open_library
    from gensim2.objects.library.folder import find_source

    folder, given = find_source(source), _positions(keypoints)
    # Import late: these modules import SciPy, and invalid arguments should be reported before this slow import.
    from gensim2.inspection.validate import check_object
    from gensim2.objects.library.importer import import_object

    model: dict[str, Any] = {
        "joint": joint,
        "scale": scale,
        "up": up,
        "keypoints": given,
        "like": like,
        "license": license,
    }
    imported = import_object(folder, out, asset_class, name, replace=force, **model)
    progress.start(f"taking {asset_class}/{name} apart and checking it", 1)
    library = open_library(out)
    simulates = importlib.util.find_spec("sapien") is not None
    checked = check_object(library, asset_class, name, physics=simulates)
    progress.advance()
    picture = (
        out / "pictures" / f"{asset_class}_{name}.png"
        if not any(each.check == "loads" for each in checked.findings)
        else None
    )
    if picture is not None:
        from gensim2.inspection.pictures import png, strip

        write_atomic(picture, png(strip(library.load_articulated(asset_class, name), PICTURE_SIZE)))
    result = {
        "schema_version": 1,
        **imported.to_dict(),
        "simulated": simulates,
        "object": checked.to_dict(),
        "picture": None if picture is None else str(picture),
    }
    return result if checked.sound else Ending(result)


def _positions(given: tuple[str, ...]) -> dict[str, list[float]]:
    """Read the positions by keypoint in the values of ``--keypoint``: a position, or a file of several."""
    from gensim2.core.yaml_files import read_yaml

    found: dict[str, list[float]] = {}
    for text in given:
        name, equals, numbers = text.partition("=")
        try:
            found |= {name: [float(each) for each in numbers.split(",")]} if equals else dict(read_yaml(Path(text)))
        except ValueError as error:
            remedy = "give NAME=X,Y,Z, for example head=0.2,0,0.01"
            raise InputError(f"{text!r} does not contain three numbers", field="--keypoint", remedy=remedy) from error
    return found

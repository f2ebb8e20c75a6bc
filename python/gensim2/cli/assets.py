"""Commands ``gensim2 assets list`` and ``gensim2 assets show``."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import click

from gensim2.cli.assets_files import export, import_
from gensim2.cli.assets_pictures import gallery, render
from gensim2.cli.assets_validate import prepare, validate
from gensim2.cli.options import command
from gensim2.cli.output import line, table
from gensim2.cli.typed import Option
from gensim2.core.progress import Progress


def _show(result: dict[str, Any]) -> None:
    rows = [
        (entry["class"], len(entry["instances"]), entry["joint"] or "rigid", entry["source"], entry["description"])
        for entry in result["classes"]
    ]
    table(("class", "instances", "joint", "source", "what"), rows)
    line(f"library: {result['library']} ({result['license']})")


def _show_object(result: dict[str, Any]) -> None:
    line(f"{result['class']}/{result['id']}: {result['description']}")
    table(("what", "value"), [*_common_rows(result), *(_joint_rows(result) if result["joint"] else _grip_rows(result))])
    table(
        ("keypoint", "link", "position in the link's frame [m]", "what"),
        [(name, k["link"], _numbers(k["position"]), k["description"]) for name, k in result["keypoints"].items()],
    )
    for warning in result["warnings"]:
        line(f"note: {warning}")


def _common_rows(result: dict[str, Any]) -> list[tuple[str, str]]:
    placement = result["placement"]
    return [
        ("source", f"{result['source']} ({result['license']})"),
        ("mass", f"{result['mass']:.3g} kg"),
        ("size closed" if result["joint"] else "size", " x ".join(f"{v:.3f}" for v in result["size"]) + " m"),
        ("stands at", f"({_numbers(placement['position'])}), quaternion ({_numbers(placement['quaternion'])})"),
        ("convex parts", ", ".join(f"{link} {count}" for link, count in result["hulls"].items())),
        ("split", result["split"]),
    ]


def _joint_rows(result: dict[str, Any]) -> list[tuple[str, str]]:
    joint = result["joint"]
    unit, torque = ("rad", "N m") if joint["type"] == "revolute" else ("m", "N")
    return [
        ("joint", f"{joint['name']}, {joint['type']}, {joint['lower']:.3g} to {joint['upper']:.3g} {unit}"),
        ("holds against", f"{joint['friction']:.3g} {torque}, damping {joint['damping']:.3g} {torque} s/{unit}"),
        ("axis", f"({_numbers(joint['axis'])}) through ({_numbers(joint['origin'])}), root frame"),
        ("openness at start", f"{result['default_openness']:g}"),
        ("files", result["urdf"]),
    ]


def _grip_rows(result: dict[str, Any]) -> list[tuple[str, str]]:
    grip = result["grip"]
    return [
        ("friction", f"{result['friction']:g}"),
        ("held at", f"({_numbers(grip['point'])}) along ({_numbers(grip['axis'])}), {1e3 * grip['width']:.0f} mm wide"),
        ("files", result["folder"]),
    ]


def _numbers(values: list[float]) -> str:
    return ", ".join(f"{value:.4g}" for value in values)


@command(name="list", show=_show)
def list_assets(*, assets: str | None, kind: Literal["articulated", "rigid"] | None = None) -> dict[str, Any]:
    """List the classes of an object library with their instances.

    A class of rigid objects always has exactly one instance.

    Args:
        kind: List only articulated or only rigid objects.  [default: both]
    """
    from gensim2.objects import listing, open_library

    library = open_library(assets)
    classes = [
        {
            "class": row.asset_class,
            "kind": row.kind,
            "instances": list(row.ids),
            "joint": row.joint_type,
            "source": row.source,
            "license": row.license,
            "description": row.description,
        }
        for row in listing(library)
        if kind in (None, row.kind)
    ]
    return {"schema_version": 1, "library": library.name, "license": library.license, "classes": classes}


@command(show=_show_object)
def show(
    object_: Annotated[str, Option(metavar="CLASS[/WHICH]")], *, assets: str | None, seed: int, progress: Progress
) -> dict[str, Any]:
    """Describe an object.

    The command prints the object's joint or grasp, keypoints, mass, placement and files. WHICH selects objects of the
    class CLASS: give an id, train, test, new, all or random. If WHICH selects several objects, the command describes
    the first one. Without WHICH, the command describes the first object of the class.
    """
    from gensim2.objects import open_library
    from gensim2.objects.library.selection import select_one

    library = open_library(assets)
    item = select_one(library, object_, seed=seed)
    # Import late: this module imports SciPy, and invalid arguments should be reported before this slow import.
    from gensim2.objects.library.describe import describe

    progress.start(f"preparing {'/'.join(item)}", 1)
    found = {"schema_version": 1, **describe(library, library.load(*item))}
    progress.advance()
    return found


assets = click.Group(
    "assets",
    commands=[list_assets, show, validate, prepare, export, import_, render, gallery],
    help="Inspect, check and extend the object library.",
)

"""``gensim2 assets rigid``: objects without a joint."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.assets_validate import object_line
from gensim2.cli.main import FOUND_WRONG
from gensim2.cli.output import line, report, table

_assets = click.option(
    "--assets",
    metavar="DIR|builtin|ycb",
    default=None,
    help="Folder of objects, 'builtin' for the generated ones, or 'ycb' for ManiSkill's download."
    "  [default: $GENSIM2_ASSETS, else builtin]",
)


@click.group("rigid")
def rigid() -> None:
    """Objects without a joint: food, dishes, tools."""


@rigid.command("list", cls=options.Command)
@_assets
@options.json_file
def list_rigid(assets: str | None, json_file: str | None) -> None:
    """List the rigid objects with their masses and sizes."""
    with report(json_file, _show_list) as (progress, give):
        from gensim2.objects import open_rigid_library

        library = open_rigid_library(assets)
        names = library.names()
        progress.start(f"rigid objects of {library.name}", len(names))
        objects = []
        for name in names:
            loaded = library.load(name)
            objects.append(
                {
                    "name": name,
                    "description": library.describe(name),
                    "mass": loaded.inertial.mass,
                    "size": loaded.size.tolist(),
                    "hulls": len(loaded.hulls),
                    "grip_width": loaded.grip.width,
                    "keypoints": {
                        k: {"position": p.position.tolist(), "description": p.description}
                        for k, p in loaded.keypoints.items()
                    },
                    "warnings": list(loaded.warnings),
                }
            )
            progress.advance()
        give({"schema_version": 1, "library": library.name, "license": library.license, "objects": objects})


def _show_list(result: dict[str, Any]) -> None:
    table(
        ("object", "mass [g]", "size [mm]", "grip [mm]", "what"),
        [
            (
                entry["name"],
                f"{1e3 * entry['mass']:.0f}",
                " x ".join(f"{1e3 * s:.0f}" for s in entry["size"]),
                f"{1e3 * entry['grip_width']:.0f}",
                entry["description"],
            )
            for entry in result["objects"]
        ],
    )
    line(f"library: {result['library']} ({result['license']})")


@rigid.command("validate", cls=options.Command)
@click.argument("names", nargs=-1, metavar="[NAME]...")
@_assets
@options.json_file
@click.pass_context
def validate(ctx: click.Context, names: tuple[str, ...], assets: str | None, json_file: str | None) -> None:
    """Check that objects load whole, stay where they rest and fit into a gripper.

    Prints one line an object; ends with 1 where one is not sound.
    """
    with report(json_file, _show_verdicts) as (progress, give):
        from gensim2.objects import open_rigid_library

        library = open_rigid_library(assets)
        chosen = library.chosen(names)
        from gensim2.inspection.rigid import validate_rigid  # brings SciPy: after what can be refused

        started, reports = time.perf_counter(), []
        progress.start(f"checking rigid objects of {library.name}", len(chosen))
        for each in validate_rigid(library, chosen):
            reports.append(each)
            progress.advance()
        sound = sum(each.sound for each in reports)
        give(
            {
                "schema_version": 1,
                "library": library.name,
                "sound": sound,
                "objects": [each.to_dict() for each in reports],
                "seconds": round(time.perf_counter() - started, 1),
            }
        )
    if sound < len(reports):
        ctx.exit(FOUND_WRONG)


def _show_verdicts(result: dict[str, Any]) -> None:
    for entry in result["objects"]:
        line(object_line(entry))
    line(f"{result['sound']} of {len(result['objects'])} rigid objects of {result['library']} are sound")


@rigid.command("render", cls=options.Command)
@click.argument("names", nargs=-1, metavar="[NAME]...")
@_assets
@click.option(
    "--out", type=click.Path(path_type=Path, dir_okay=False), required=True, metavar="PNG", help="The picture."
)
@click.option(
    "--size", type=click.IntRange(64, 2048), default=180, show_default=True, help="Edge of each view in pixels."
)
@options.json_file
def render(names: tuple[str, ...], assets: str | None, out: Path, size: int, json_file: str | None) -> None:
    """Draw one object from three sides with its keypoints, or several on one sheet (all where none is named)."""
    with report(json_file, lambda result: line(result["picture"])) as (_, give):
        import io

        from gensim2.files import check_writable, write_output
        from gensim2.objects import open_rigid_library

        library = open_rigid_library(assets)
        chosen = library.chosen(names)
        check_writable(out)
        from gensim2.inspection.pictures import Studio, contact_sheet, rigid_strip

        subjects = [library.load(name) for name in chosen]
        studio = Studio(size)
        sheet = rigid_strip(studio, subjects[0]) if len(subjects) == 1 else contact_sheet(studio, subjects, columns=9)
        stream = io.BytesIO()
        sheet.save(stream, "PNG")
        write_output(out, stream.getvalue())
        give({"schema_version": 1, "objects": [s.name for s in subjects], "picture": str(out)})

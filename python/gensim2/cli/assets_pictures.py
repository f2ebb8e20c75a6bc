"""``gensim2 assets render`` and ``gensim2 assets gallery``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.output import line, report


@click.command("render", cls=options.Command, short_help="Picture of one object, or of several.")
@click.argument("objects", nargs=-1, required=True, metavar="CLASS[/WHICH]...")
@options.assets
@options.seed
@click.option(
    "--out", type=click.Path(path_type=Path, dir_okay=False), required=True, metavar="PNG", help="The picture."
)
@click.option(
    "--size", type=click.IntRange(64, 2048), default=420, show_default=True, help="Edge of each view in pixels."
)
@options.json_file
def render(
    objects: tuple[str, ...], assets: str | None, seed: int, out: Path, size: int, json_file: str | None
) -> None:
    """Draw one object at openness 0, 0.5 and 1, or a rigid one from three sides, its keypoints named.

    Of several, one picture each on one sheet. WHICH is an id, train, test, new, all or random, of which the first
    counts; without it the first of the class.
    """
    with report(json_file, lambda result: line(result["picture"])) as (_, give):
        import io

        from gensim2.core.files import check_writable, write_output
        from gensim2.objects import open_library
        from gensim2.objects.library.selection import select_one

        library = open_library(assets)
        items = [select_one(library, word, seed=seed) for word in objects]
        check_writable(out)
        from gensim2.inspection.pictures import Studio, contact_sheet, strip

        models = [library.load(*item) for item in items]
        studio = Studio(size)
        sheet = strip(studio, models[0]) if len(models) == 1 else contact_sheet(studio, models, columns=9)
        stream = io.BytesIO()
        sheet.save(stream, "PNG")
        write_output(out, stream.getvalue())
        drawn = [{"class": asset_class, "id": instance_id} for asset_class, instance_id in items]
        give({"schema_version": 2, "objects": drawn, "picture": str(out)})


@click.command("gallery", cls=options.Command, short_help="Page with pictures of every object.")
@click.option(
    "--assets",
    "where",
    multiple=True,
    metavar="DIR|builtin",
    help="Folder of objects, or 'builtin'; may be given more than once."
    "  [default: builtin, and $GENSIM2_ASSETS where set]",
)
@click.option("--classes", default=None, metavar="A,B,...", help="Only these classes.")
@click.option(
    "--findings",
    type=click.Path(path_type=Path),
    multiple=True,
    metavar="FILE",
    help="What `gensim2 assets validate --json FILE` wrote, to be shown beside the pictures.",
)
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True, metavar="DIR", help="The page.")
@click.option("--views", type=click.IntRange(1, 36), default=8, show_default=True, help="Pictures around an object.")
@click.option(
    "--size", type=click.IntRange(32, 1024), default=176, show_default=True, help="Edge of each view in pixels."
)
@options.json_file
def gallery(
    where: tuple[str, ...],
    classes: str | None,
    findings: tuple[Path, ...],
    out: Path,
    views: int,
    size: int,
    json_file: str | None,
) -> None:
    """Make a static page with a turntable picture of every object, at openness 0, 0.5 and 1 where it has a joint.

    Pictures that an earlier run made of the same objects are kept: after Ctrl-C the same command goes on.
    """
    with report(json_file, _show) as (progress, give):
        import os

        from gensim2.objects import open_library
        from gensim2.objects.library.selection import wanted_classes

        chosen = where or ("builtin", *filter(None, [os.environ.get("GENSIM2_ASSETS")]))
        places = list(dict.fromkeys(chosen))
        libraries = [open_library(place) for place in places]
        named = None if classes is None else [name.strip() for name in classes.split(",") if name.strip()]
        wanted_classes(libraries, named)
        from gensim2.inspection.gallery import build_gallery

        built = build_gallery(
            libraries,
            out,
            classes=named,
            findings=findings,
            views=views,
            size=size,
            progress=progress,
        )
        give(
            {
                "schema_version": 1,
                "index": str(built.index),
                "made": built.made,
                "kept": built.kept,
                "refused": [{"class": c, "id": i, "reason": why} for c, i, why in built.refused],
            }
        )


def _show(result: dict[str, Any]) -> None:
    for entry in result["refused"]:
        line(f"{entry['class']}/{entry['id']}: no picture: {entry['reason']}")
    line(f"{result['made']} pictures made, {result['kept']} kept: {result['index']}")

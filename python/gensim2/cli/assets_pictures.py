"""Commands ``gensim2 assets render`` and ``gensim2 assets gallery``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any

import click

from gensim2.cli.options import command
from gensim2.cli.output import line
from gensim2.cli.tasks import Page
from gensim2.cli.typed import Option
from gensim2.core.files import check_writable, write_output
from gensim2.core.plural import plural
from gensim2.core.progress import Progress


def _show(result: dict[str, Any]) -> None:
    for entry in result["refused"]:
        line(f"{entry['class']}/{entry['id']}: no picture: {entry['reason']}")
    line(f"{plural(result['made'], 'picture')} made, {result['kept']} kept: {result['index']}")


@command(show=lambda result: line(result["picture"]))
def render(
    objects: Annotated[tuple[str, ...], Option(metavar="CLASS[/WHICH]...")],
    *,
    assets: str | None,
    seed: int,
    out: Annotated[Path, click.Path(path_type=Path, dir_okay=False), Option(metavar="PNG")],
    size: Annotated[int, click.IntRange(64, 2048)] = 420,
) -> dict[str, Any]:
    """Draw a picture of one or several objects.

    WHICH selects objects of the class CLASS: give an id, train, test, new, all or random. If WHICH selects several
    objects, the command draws the first one. Without WHICH, the command draws the first object of the class.

    If you select one object, the picture shows the object with the names of its keypoints: an articulated object at
    openness 0, 0.5 and 1, and a rigid object from three sides. If you select several objects, the picture shows each
    object once.

    Args:
        out: Image file to write.
        size: Edge length of each view in pixels.
    """
    from gensim2.objects import open_library
    from gensim2.objects.library.selection import select_one

    library = open_library(assets)
    items = [select_one(library, word, seed=seed) for word in objects]
    check_writable(out)
    # Import late: this import is slow, and invalid arguments should be reported before it.
    from gensim2.inspection.pictures import contact_sheet, png, strip

    models = [library.load(*item) for item in items]
    sheet = strip(models[0], size) if len(models) == 1 else contact_sheet(models, columns=9, size=size)
    write_output(out, png(sheet))
    drawn = [{"class": asset_class, "id": instance_id} for asset_class, instance_id in items]
    return {"schema_version": 2, "objects": drawn, "picture": str(out)}


@command(show=_show)
def gallery(
    *,
    where: Annotated[tuple[str, ...], Option("--assets", "DIR|builtin")] = (),
    classes: Annotated[str | None, Option(metavar="A,B,...")] = None,
    findings: Annotated[tuple[Path, ...], Option(metavar="FILE")] = (),
    out: Page,
    views: Annotated[int, click.IntRange(1, 36)] = 8,
    size: Annotated[int, click.IntRange(32, 1024)] = 176,
    progress: Progress,
) -> dict[str, Any]:
    """Write a page with pictures of every object.

    The page shows every object from several directions around it. Articulated objects are also shown at openness 0, 0.5
    and 1. Existing pictures of unchanged objects are reused. After Ctrl-C, run the same command again to continue.

    Args:
        where: Folder of objects, or 'builtin'; can be repeated.  [default: builtin, and $GENSIM2_ASSETS if set]
        classes: Show only these classes.
        findings: File written by `gensim2 assets validate --json FILE`, whose findings are shown beside the pictures.
        out: Folder of the page.
        views: Number of views around an object.
        size: Edge length of each view in pixels.
    """
    from gensim2.objects import open_library
    from gensim2.objects.library.selection import wanted_classes

    chosen = where or ("builtin", *filter(None, [os.environ.get("GENSIM2_ASSETS")]))
    libraries = [open_library(place) for place in dict.fromkeys(chosen)]
    named = None if classes is None else [name.strip() for name in classes.split(",") if name.strip()]
    wanted_classes(libraries, named)
    from gensim2.inspection.gallery import build_gallery

    built = build_gallery(libraries, out, classes=named, findings=findings, views=views, size=size, progress=progress)
    return {
        "schema_version": 1,
        "index": str(built.index),
        "made": built.made,
        "kept": built.kept,
        "refused": [{"class": c, "id": i, "reason": why} for c, i, why in built.refused],
    }

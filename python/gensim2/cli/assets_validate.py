"""Commands ``gensim2 assets validate`` and ``gensim2 assets prepare``."""

from __future__ import annotations

import time
from typing import Annotated, Any

from gensim2.cli.options import Ending, command
from gensim2.cli.output import line, table
from gensim2.cli.typed import Option, count
from gensim2.core.files import cache_dir
from gensim2.core.plural import plural
from gensim2.core.progress import Progress

Objects = Annotated[tuple[str, ...], Option(metavar="[CLASS[/WHICH]]...")]
Every = Annotated[bool, Option("--all")]


def _show(result: dict[str, Any]) -> None:
    for entry in result["objects"]:
        line(object_line(entry))
    if result["checks"]:
        table(("finding", "objects"), list(result["checks"].items()))
    line(f"{result['sound']} of {len(result['objects'])} objects of {result['library']} are sound")


def object_line(entry: dict[str, Any]) -> str:
    """Return a line of text about a validated object."""
    name = f"{entry['class']}/{entry['id']}"
    if entry["sound"]:
        return f"ok     {name}"
    return f"FAULT  {name}: " + "; ".join(f"{f['check']}: {f['value']} (limit {f['limit']})" for f in entry["findings"])


def _show_prepared(result: dict[str, Any]) -> None:
    for entry in result["refused"]:
        line(f"{entry['class']}/{entry['id']}: {entry['reason']}")
    line(f"{plural(result['prepared'], 'object')} of {result['library']} prepared in {result['cache']}")


@command(show=_show)
def validate(
    objects: Objects = (),
    *,
    assets: str | None,
    every: Every = False,
    drawn: Annotated[int | None, count(), Option("--random", "N")] = None,
    seed: int,
    physics: bool = True,
    workers: int,
    progress: Progress,
) -> dict[str, Any] | Ending:
    """Check the geometry and the physics of objects.

    The checks test that objects are complete, stay at rest, move as their joint allows and can be reached by the robot.
    WHICH selects objects of the class CLASS: give an id, train, test, new, all or random. The command prints one line
    for each object. The exit code is 1 if an object fails a check.

    Args:
        every: Check all objects of the library. This is the default if no CLASS is given.
        drawn: Also check N random objects of each class. They are newly generated, or chosen from the folder of
            --assets.
        physics: Simulate each object.
    """
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
    return result if result["sound"] == len(reports) else Ending(result)


@command(show=_show_prepared)
def prepare(
    objects: Objects = (), *, assets: str | None, every: Every = False, seed: int, workers: int, progress: Progress
) -> dict[str, Any] | Ending:
    """Prepare objects in advance instead of on first use.

    The command decomposes objects that come from files into convex parts, and it generates the built-in objects. It
    stores the results in the cache. The exit code is 1 if an object cannot be used.

    Args:
        every: Prepare all objects of the library. This is the default if no CLASS is given.
    """
    from gensim2.objects import open_library
    from gensim2.objects.library.selection import select

    library = open_library(assets)
    items = select(library, objects, every=every, seed=seed)
    from gensim2.objects.library.catalogue import load_all

    progress.start(f"preparing objects of {library.name}", len(items))
    refused = []
    for item, reason in load_all(library, items, min(workers, len(items))):
        if reason is not None:
            refused.append({"class": item[0], "id": item[1], "reason": reason})
        progress.advance()
    result = {
        "schema_version": 1,
        "library": library.name,
        "prepared": len(items) - len(refused),
        "refused": refused,
        "cache": str(cache_dir()),
    }
    return Ending(result) if refused else result

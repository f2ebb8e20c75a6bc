"""``gensim2 assets``."""

from __future__ import annotations

from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.assets_pictures import gallery, render
from gensim2.cli.output import line, report, table


@click.group("assets")
def assets() -> None:
    """The object library."""


assets.add_command(render)
assets.add_command(gallery)


@assets.command("list")
@options.assets
@options.json_file
def list_assets(assets: str | None, json_file: str | None) -> None:
    """List the classes of the library with their instances."""
    with report(json_file, _show) as (_, give):
        from gensim2.assets import listing, open_library

        library = open_library(assets)
        classes = [
            {
                "class": row.asset_class,
                "instances": list(row.ids),
                "joint": row.joint_type,
                "license": row.license,
                "description": row.description,
            }
            for row in listing(library)
        ]
        give(
            {
                "schema_version": 1,
                "library": library.name,
                "license": library.license,
                "classes": classes,
            }
        )


def _show(result: dict[str, Any]) -> None:
    rows = [
        (entry["class"], len(entry["instances"]), entry["joint"], entry["description"]) for entry in result["classes"]
    ]
    table(("class", "instances", "joint", "what"), rows)
    line(f"library: {result['library']} ({result['license']})")

"""``gensim2 doctor``."""

from __future__ import annotations

from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.main import FOUND_WRONG
from gensim2.cli.output import report, table


@click.command("doctor", cls=options.Command, short_help="Say what works here and what is missing.")
@options.assets
@options.json_file
@click.pass_context
def doctor(ctx: click.Context, assets: str | None, json_file: str | None) -> None:
    """Say what this machine can do and what is missing.

    Ends with 1 where something is missing that gensim2 does not work without.
    """
    with report(json_file, _show) as (_, give):
        from gensim2.doctor import doctor as function

        diagnosis = function(assets)
        give(diagnosis.to_dict())
    if not diagnosis.healthy:
        ctx.exit(FOUND_WRONG)


def _show(result: dict[str, Any]) -> None:
    rows = [(check["name"], check["status"], check["value"], check["remedy"]) for check in result["checks"]]
    table(("what", "status", "found", "remedy"), rows)

"""``gensim2 doctor``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.main import FOUND_WRONG
from gensim2.cli.output import report, table


@click.command("doctor", cls=options.Command, short_help="Say what works here and what is missing.")
@options.assets
@click.option("--designer", "model", metavar="MODEL", help="A language model that is asked for one word.")
@click.option("--base-url", metavar="URL", help="URL of its endpoint.  [default: $OPENAI_BASE_URL, else OpenAI's]")
@click.option("--model-config", type=click.Path(path_type=Path), metavar="FILE", help="How it is asked (YAML).")
@options.json_file
@click.pass_context
def doctor(
    ctx: click.Context,
    assets: str | None,
    model: str | None,
    base_url: str | None,
    model_config: Path | None,
    json_file: str | None,
) -> None:
    """Say what this machine can do and what is missing.

    Whether a language model answers is tried where an endpoint is named, by an option or by the environment.

    Ends with 1 where something is missing that gensim2 does not work without.
    """
    with report(json_file, _show) as (_, give):
        from gensim2.doctor import doctor as function

        diagnosis = function(assets, model, base_url, model_config)
        give(diagnosis.to_dict())
    if not diagnosis.healthy:
        ctx.exit(FOUND_WRONG)


def _show(result: dict[str, Any]) -> None:
    rows = [(check["name"], check["status"], check["value"], check["remedy"]) for check in result["checks"]]
    table(("what", "status", "found", "remedy"), rows)

"""Command ``gensim2 doctor``."""

from __future__ import annotations

from typing import Annotated, Any

from gensim2.cli.options import Ending, command
from gensim2.cli.output import table
from gensim2.cli.typed import File, Option


def _show(result: dict[str, Any]) -> None:
    rows = [(check["name"], check["status"], check["value"], check["remedy"]) for check in result["checks"]]
    table(("what", "status", "found", "remedy"), rows)


@command(show=_show)
def doctor(
    *,
    assets: str | None,
    model: Annotated[str | None, Option("--designer", "MODEL")] = None,
    base_url: Annotated[str | None, Option(metavar="URL")] = None,
    model_config: File | None = None,
) -> dict[str, Any] | Ending:
    """Report which parts of gensim2 work on this machine and what is missing.

    If an option or an environment variable names an endpoint, the command sends a test question to the language model.
    The exit code is 1 if a required part is missing.

    Args:
        model: Language model to test with a one-word question.
        base_url: URL of the model's endpoint.  [default: $OPENAI_BASE_URL, else OpenAI's]
        model_config: YAML file with settings of the requests.
    """
    from gensim2.doctor import doctor as function

    diagnosis = function(assets, model, base_url, model_config)
    return diagnosis.to_dict() if diagnosis.healthy else Ending(diagnosis.to_dict())

"""``gensim2 tasks``."""

from __future__ import annotations

from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.output import report, table


@click.group("tasks")
def tasks() -> None:
    """The task library."""


@tasks.command("list", cls=options.Command)
@options.json_file
def list_tasks(json_file: str | None) -> None:
    """List the tasks of the library."""
    with report(json_file, _show) as (_, give):
        from gensim2.tasks.library import load_task, task_names

        specs = [load_task(name) for name in task_names()]
        give(
            {
                "schema_version": 1,
                "tasks": [
                    {
                        **spec.model_dump(mode="json"),
                        "env_id": spec.env_id,
                        "origin": None if spec.provenance is None else spec.provenance.origin,
                    }
                    for spec in specs
                ],
            }
        )


def _show(result: dict[str, Any]) -> None:
    rows = [
        (
            task["name"],
            ", ".join(dict.fromkeys(thing["class"] for thing in task["objects"].values())),
            len(task["steps"]),
            task["description"],
            task["env_id"],
        )
        for task in result["tasks"]
    ]
    table(("task", "objects", "steps", "what", "environment"), rows)

"""``gensim2 tasks``."""

from __future__ import annotations

from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.output import line, report, table
from gensim2.cli.tasks_gallery import gallery
from gensim2.cli.tasks_memory import add, export, remove


@click.group("tasks")
def tasks() -> None:
    """The task library."""


for command in (gallery, add, remove, export):
    tasks.add_command(command)


@tasks.command("list", cls=options.Command)
@click.option("--origin", metavar="NAME", default=None, help="Only those that NAME proposed: paper, or a designer.")
@options.library
@options.json_file
def list_tasks(origin: str | None, json_file: str | None) -> None:
    """List the tasks of the library: the paper's suite, those that were designed, and your own."""
    with report(json_file, _show_list) as (_, give):
        from gensim2.tasks.library import load_task, origin_of, packaged_names, task_names

        specs = [load_task(name) for name in task_names(origin)]
        give(
            {
                "schema_version": 1,
                "tasks": [
                    {
                        **spec.model_dump(mode="json"),
                        "origin": origin_of(spec),
                        "packaged": spec.name in packaged_names(),
                        "env_id": spec.env_id if spec.name in packaged_names() else None,
                    }
                    for spec in specs
                ],
            }
        )


@tasks.command("show", cls=options.Command)
@click.argument("task")
@options.library
@options.json_file
def show(task: str, json_file: str | None) -> None:
    """Tell everything of TASK, a task of the library or a folder that holds task.yaml and strategies/.

    Its sentence, objects, steps, strategies and where they come from, its goal, and how often it succeeds: in the
    paper, with the original's release, and here.
    """
    with report(json_file, _show_task) as (_, give):
        from gensim2.design.description import description_of
        from gensim2.objects import open_library
        from gensim2.rollout.inputs import task_and_strategies

        spec, strategies = task_and_strategies(task)
        give({"schema_version": 1, **description_of(spec, strategies, open_library("builtin"))})


def _show_list(result: dict[str, Any]) -> None:
    rows = [
        (
            task["name"],
            f"{task['origin'] or ''}{'' if task['packaged'] else ' (yours)'}",
            ", ".join(dict.fromkeys(thing["class"] for thing in task["objects"].values())),
            len(task["steps"]),
            task["description"],
            task["env_id"] or "",
        )
        for task in result["tasks"]
    ]
    table(("task", "origin", "objects", "steps", "what", "environment"), rows)


def _show_task(task: dict[str, Any]) -> None:
    line(f"{task['name']}: {task['description']}")
    environment = "" if task["env_id"] is None else f"{task['env_id']}, "
    line(f"{task['type']}, {environment}at most {task['max_episode_steps']} control steps")
    _show_provenance(task)
    line(f"goal: {task['goal']}\n")
    rows = [(thing["name"], thing["class"], thing["place"], thing["randomization"]) for thing in task["objects"]]
    table(("object", "class", "stands", "randomization"), rows)
    line("")
    table(("", "step", "acts on", "with", "strategies, in order", "until"), _steps(task["steps"]))
    line("")
    _show_figures(task["figures"])


def _show_provenance(task: dict[str, Any]) -> None:
    if task["origin"] is not None:
        line(f"proposed by {task['origin']}" + (f", prompts {task['prompts'][:12]}" if task["prompts"] else ""))
    if (found := task["verification"]) is not None:
        low, high = found["interval"]
        objects = ", ".join(f"{count} {name}" for name, count in found["objects"].items())
        held = f"{found['held']} of {found['episodes']} fresh episodes held ({low:.2f} to {high:.2f})"
        line(f"verified: {held}, seed {found['seed']}, {found['instances']} objects: {objects}")


def _steps(steps: list[dict[str, Any]]) -> list[tuple[object, ...]]:
    return [
        (
            number,
            step["name"],
            step["object"],
            step["tool"] or "the hand",
            "\n".join(_strategy(strategy) for strategy in step["strategies"]),
            step["done"],
        )
        for number, step in enumerate(steps, 1)
    ]


def _strategy(strategy: dict[str, Any]) -> str:
    made = "" if strategy["by"] is None else f" (by {strategy['by']}, seen: {strategy['seen']})"
    return f"{strategy['name']}: {strategy['kind']}{made}"


def _show_figures(figures: dict[str, Any]) -> None:
    rows: list[tuple[object, ...]] = []
    if (paper := figures["paper"]) is not None:
        rows.append(("the paper", "", f"{paper['mean']:.2f} ± {paper['deviation']:.2f}", "", ""))
    if (original := figures["original"]) is not None:
        rate = original["successes"] / original["episodes"]
        rows.append(("the original's release, as measured", original["episodes"], f"{rate:.2f}", "", ""))
    for row in figures["measured"]:
        (low, high), rates = row["rates"]["held"]["interval"], row["rates"]
        held = f"{rates['held']['mean']:.2f} ({low:.2f} to {high:.2f})"
        words = (f"{rates['paper']['mean']:.2f}", held, f"{rates['strict']['mean']:.2f}")
        rows.append((row["in_words"], row["episodes"], *words))
    if rows:
        table(("figures", "episodes", "paper", "held (95 %)", "strict"), [tuple(map(str, row)) for row in rows])
    else:
        line("no figures: it has not been measured")

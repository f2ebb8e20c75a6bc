"""``gensim2 evaluate``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.output import line, report, table
from gensim2.core.errors import InputError


@click.command("evaluate", cls=options.Command, short_help="Measure how often a controller of your own succeeds.")
@click.argument("tasks", nargs=-1, required=True)
@click.option(
    "--checkpoint",
    default=None,
    metavar="DIR|builtin",
    help="A policy that gensim2 learn or train made, or the one of the single-step tasks that comes with gensim2, in "
    "place of --controller.",
)
@options.controls("none")
@click.option(
    "--controller",
    default=None,
    metavar="module:Class|FILE.py:Class",
    help="Made with the keywords of --controller-args; reset(observation, seed) and act(observation) decide.",
)
@click.option("--controller-args", "arguments", default="{}", metavar="JSON", help="Keywords that it is made with.")
@click.option(
    "--data",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    default=None,
    metavar="DIR",
    help="Rendered data set that it was trained on: refuse to evaluate with other observations.",
)
@click.option(
    "--stop",
    type=click.Choice(("goal", "controller")),
    default="goal",
    show_default=True,
    help="An episode ends where the goal has held for half a second and still does when the scene rests, or time is "
    "over, and is judged; or only where the "
    "controller says None, and one that never does is cut.",
)
@click.option("--runs", type=options.count(1000), default=1, show_default=True, help="Repetitions.")
@click.option(
    "--episodes",
    type=options.count(),
    default=50,
    show_default=True,
    help="Number of episodes of each task in each run.",
)
@click.option(
    "--videos",
    type=click.IntRange(0, 1000),
    default=0,
    show_default=True,
    help="Number of episodes of each task to film.",
)
@options.library
@options.seed
@options.assets
@options.instances
@options.engine
@options.physics
@options.randomization
@options.robot
@options.out("Folder to write to.  [default: runs/<date>-<time>]")
@options.processes
@options.ray
@options.resume
@options.json_file
def evaluate(
    tasks: tuple[str, ...],
    checkpoint: str | None,
    controls: str,
    control_episodes: int,
    controller: str | None,
    arguments: str,
    json_file: str | None,
    **given: Any,
) -> None:
    """Run a controller on TASKS, on the random scenes of the benchmark, and judge it as the benchmark does.

    What a controller sees has the names that it has in exports; see docs/guides/controllers.md.
    """
    if (checkpoint is None) == (controller is None):
        raise click.UsageError("Give either --controller or --checkpoint.")
    if checkpoint is None and controls != "none":
        raise click.UsageError("--controls are those of a --checkpoint.")
    with report(json_file, _show) as (progress, give):
        if checkpoint is None:
            from gensim2.evaluation import evaluate as function

            assert controller is not None
            give(function(controller, tasks, arguments=_arguments(arguments), progress=progress, **given).to_dict())
            return
        from gensim2.policy.evaluating import evaluate_policy, read_controls

        measured = evaluate_policy(
            checkpoint,
            tasks,
            arguments=_arguments(arguments),
            controls=read_controls(controls),
            control_episodes=control_episodes,
            progress=progress,
            **given,
        )
        give(measured.to_dict())


def _arguments(text: str) -> dict[str, Any]:
    try:
        found = json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(f"is not valid JSON: {error.msg}", field="--controller-args") from error
    if not isinstance(found, dict):
        raise InputError("must be a JSON object: keywords and their values", field="--controller-args")
    return found


def _show(result: dict[str, Any]) -> None:
    speeds = result["episodes_per_second"]
    rows = [
        (
            row["name"],
            row["episodes"],
            *(f"{row[f'{name}_mean']:.2f} {_interval(row, name)}" for name in ("success", "held", "strict")),
            row["different_objects"],
            "" if speeds[row["name"]] is None else f"{speeds[row['name']]:.2f}",
            ", ".join(f"{count} {cause}" for cause, count in row["causes"].items()),
        )
        for row in result["tasks"]
    ]
    line(f"{result['controller']['target']}, episodes end by the {result['arguments']['stop']}")
    heads = ("task", "episodes", "paper (95 %)", "held (95 %)", "strict (95 %)", "objects", "episodes/s", "causes")
    table(heads, rows)
    for control, found in result.get("controls", {}).items():
        for row in found:
            line(f"{control}: {row['name']}: {row['held_mean']:.2f} {_interval(row, 'held')} of {row['episodes']}")
    for name, reason in result["skipped"].items():
        line(f"skipped {name}: {reason}")
    for films in result["videos"].values():
        for film in films:
            line(f"video: {film}")
    line(f"{result['cpu_s']:.1f} s of CPU; episodes: {Path(result['run_dir']) / 'tasks'}")


def _interval(row: dict[str, Any], verdict: str) -> str:
    low, high = row[f"{verdict}_interval"]
    return f"({low:.2f} to {high:.2f})"

"""Command ``gensim2 evaluate``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal

import click

from gensim2.cli.benchmark import interval_of
from gensim2.cli.options import PROCESSES, SCENE, Checkpoint, command
from gensim2.cli.output import line, table
from gensim2.cli.typed import Count, Option, count
from gensim2.core.errors import InputError
from gensim2.core.progress import Progress

STOP_GUIDE = "docs/guides/controllers.md#when-an-episode-ends"


def _arguments(text: str) -> dict[str, Any]:
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"is not valid JSON: {error}", field="--controller-args") from error
    if not isinstance(found, dict):
        raise InputError("must be a JSON object that maps keyword arguments to values", field="--controller-args")
    return found


def _named(controller: dict[str, Any]) -> str:
    """Return the class of a controller and its arguments, such as the address of a policy server."""
    given = ", ".join(f"{name}={value!r}" for name, value in controller["arguments"].items())
    return f"{controller['target']}({given})" if given else str(controller["target"])


def _show(result: dict[str, Any]) -> None:
    from gensim2.rollout.record import Cause

    speeds = result["episodes_per_second"]
    rows = [
        (
            row["name"],
            row["episodes"],
            *(f"{row[f'{name}_mean']:.2f} {interval_of(row, name)}" for name in ("success", "held", "strict")),
            row["different_objects"],
            "" if speeds[row["name"]] is None else f"{speeds[row['name']]:.2f}",
            ", ".join(f"{count} {cause}" for cause, count in row["causes"].items()),
        )
        for row in result["tasks"]
    ]
    line(f"{_named(result['controller'])}, episodes end by the {result['arguments']['stop']}")
    heads = ("task", "episodes", "paper (95 %)", "held (95 %)", "strict (95 %)", "objects", "episodes/s", "causes")
    table(heads, rows)
    if result["arguments"]["stop"] == "controller" and any(Cause.TIME_OVER in row["causes"] for row in result["tasks"]):
        line(f"{Cause.TIME_OVER}: the controller did not stop before the time limit ({STOP_GUIDE})")
    for control, found in result.get("controls", {}).items():
        for row in found:
            line(f"{control}: {row['name']}: {row['held_mean']:.2f} {interval_of(row, 'held')} of {row['episodes']}")
    for name, reason in result["skipped"].items():
        line(f"skipped {name}: {reason}")
    for films in result["videos"].values():
        for film in films:
            line(f"video: {film}")
    line(f"{result['cpu_s']:.1f} s of CPU; episodes: {Path(result['run_dir']) / 'tasks'}")


@command(
    "control_episodes", "library", "seed", *(each for each in SCENE if each != "redraw"), "out", *PROCESSES, "ray",
    "resume", show=_show,
)  # fmt: skip
def evaluate(
    tasks: tuple[str, ...],
    *,
    checkpoint: Checkpoint | None = None,
    controller: Annotated[str | None, Option(metavar="module:Class|FILE.py:Class")] = None,
    arguments: Annotated[str, Option("--controller-args", "JSON")] = "{}",
    controls: str = "none",
    data: Annotated[
        Path | None, click.Path(exists=True, file_okay=False, path_type=Path), Option(metavar="DIR")
    ] = None,
    stop: Literal["goal", "controller"] = "goal",
    runs: Annotated[int, count(1000)] = 1,
    episodes: Count = 50,
    videos: Annotated[int, click.IntRange(0, 1000)] = 0,
    control_episodes: int,
    progress: Progress,
    **given: Any,
) -> dict[str, Any]:
    """Measure the success rate of a controller or policy.

    The command runs a controller on TASKS, in the random scenes and with the verdicts (definitions of success) of
    `gensim2 benchmark`. The fields of an observation have the same names as in exported data; see
    docs/guides/controllers.md.

    Args:
        checkpoint: Policy to evaluate instead of --controller. Give a checkpoint made by gensim2 learn or train, or
            builtin for the packaged policy of the single-step tasks.
        controller: Class of the controller with the methods reset(observation, seed) and act(observation).
        arguments: Keyword arguments of the controller.
        data: Rendered data set on which the controller was trained. A controller with other observation settings is
            refused.
        stop: Event that ends an episode before its time limit. With goal, the goal must have been true for half a
            second and must still be true after the scene has come to rest. With controller, the controller must return
            None; otherwise the episode is truncated (cut off) at the time limit.
        runs: Number of repetitions.
        episodes: Number of episodes of each task in each run.
        videos: Number of episodes of each task to record as video.
    """
    from gensim2.evaluation import evaluate as function
    from gensim2.policy.evaluating import evaluate_policy, read_controls

    own: dict[str, Any] = {"data": data, "stop": stop, "runs": runs, "episodes": episodes, "videos": videos}
    given = {"arguments": _arguments(arguments), "progress": progress, **own, **given}
    if (checkpoint is None) == (controller is None):
        raise click.UsageError("Give either --controller or --checkpoint.")
    if controller is not None:
        if controls != "none":
            raise click.UsageError("--controls requires --checkpoint.")
        return function(controller, tasks, **given).to_dict()
    assert checkpoint is not None
    asked = read_controls(controls)
    return evaluate_policy(checkpoint, tasks, controls=asked, control_episodes=control_episodes, **given).to_dict()

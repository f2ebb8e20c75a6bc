"""``gensim2 learn``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.output import line, report, table


@click.command("learn", cls=options.Command, short_help="Teach tasks to a policy, and measure it.")
@click.argument("tasks", nargs=-1, required=True)
@click.option(
    "--policy",
    type=click.Choice(("keypose", "chunk", "transformer", "diffusion", "flow")),
    default="keypose",
    show_default=True,
    help="keypose: the network says where the hand goes, the planner how; taught by plans. The others give chunks of "
    "actions and are taught by episodes.",
)
@click.option(
    "--minutes",
    type=click.FloatRange(0, 1e5, min_open=True),
    default=15.0,
    show_default=True,
    help="CPU minutes for the data and the training of each policy; where a GPU trains, what the data leave of them is "
    "time by the clock. Evaluation is not bounded.",
)
@click.option("--multi-task", is_flag=True, help="One policy for all TASKS; their sentences tell them apart.")
@click.option(
    "--scenes",
    type=options.count(),
    default=2000,
    show_default=True,
    help="Most of each task to plan; of episodes at most 600.",
)
@click.option(
    "--episodes",
    type=options.count(),
    default=50,
    show_default=True,
    help="Number of episodes of each task to evaluate.",
)
@options.controls("all")
@click.option(
    "--videos",
    type=click.IntRange(0, 1000),
    default=3,
    show_default=True,
    help="Number of episodes of each task to film for the page.",
)
@click.option(
    "--objects",
    type=options.count(100_000),
    default=None,
    help="Generated ones of each class to learn from, beyond those that are listed.  [default: those of --instances, "
    "and where that is not given 200, of real objects those of train]",
)
@click.option(
    "--generated",
    type=options.count(100_000),
    default=None,
    help="Generated ones of each class to learn from beside those of --assets; the time for plans is divided by "
    "the numbers of both, and up to --scenes go into each.",
)
@click.option(
    "--verify",
    is_flag=True,
    help="Execute the plans that a keypose policy is taught by in physics, and leave out those that it refutes; a "
    "scene then takes ten times as long.",
)
@click.option(
    "--from",
    "start",
    default=None,
    metavar="DIR|builtin",
    help="A keypose policy of several tasks, as learn left it, or the package's: TASKS are added to its own, and all "
    "are measured.",
)
@click.option(
    "--demonstrations",
    type=click.Path(path_type=Path),
    default=None,
    metavar="DIR",
    help="What learn has made for another policy of the same TASKS, objects and seed: its demonstrations are taken "
    "along, and more are made where their share of --minutes is not spent.",
)
@click.option(
    "--text",
    type=click.Choice(("small", "clip", "sentence")),
    default=None,
    help="Text encoder of a policy of several tasks: one that is trained with it, CLIP's, or that of a model of "
    "sentences.  [default: that of --from, else small]",
)
@click.option(
    "--text-model",
    default=None,
    metavar="FOLDER|NAME",
    help="Folder or hub name of the weights of --text clip or sentence.  [default: CLIP's on the hub]",
)
@click.option(
    "--config",
    "settings",
    type=click.Path(path_type=Path),
    default=None,
    metavar="FILE",
    help="Settings of network and training that are to be otherwise, as YAML: encoder: pointnext.",
)
@options.noise(None, "Of the cameras, in training and in evaluation  [default: none]")
@click.option(
    "--test-instances",
    default=None,
    metavar="all|train[-K]|test[-K]|new|ID",
    help="Objects to evaluate on.  [default: new where --objects are learned from; else, and with --from a policy that "
    "was taught on listed objects, test where each class has ten or more objects, else new]",
)
@options.library
@options.seed
@options.assets
@click.option(
    "--instances",
    default=None,
    metavar="all|train[-K]|test[-K]|new|ID",
    help="Objects to learn from, in place of --objects.",
)
@options.engine
@options.physics
@options.randomization
@options.robot
@options.out("Folder to write to: a --checkpoint, or one for each task.  [default: runs/<date>-<time>]")
@options.workers
@options.device
@options.resume
@options.json_file
def learn(
    tasks: tuple[str, ...],
    out: Path | None,
    controls: str,
    instances: str | None,
    json_file: str | None,
    noise: str | None,
    **given: Any,
) -> None:
    """Teach TASKS to a policy that sees point clouds, the robot and a sentence.

    Draws scenes and plans them (for action chunks: simulates and renders them), trains, and evaluates on objects and
    seeds that no training saw, beside its controls.
    """
    with report(json_file, _show) as (progress, give):
        from gensim2.data.runfolder import default_run_dir
        from gensim2.perception.noise_file import read_noise
        from gensim2.policy.evaluating import read_controls
        from gensim2.policy.learning import learn as function

        if instances is not None:
            given["instances"] = instances
        if noise is not None:
            given["noise"] = read_noise(noise)
        where = out or default_run_dir()
        result = function(tasks, out=where, controls=read_controls(controls), progress=progress, **given)
        give(result.to_dict())


def _show(result: dict[str, Any]) -> None:
    rows = [
        (
            row["name"],
            f"{row['held_mean']:.2f} ({row['interval'][0]:.2f} to {row['interval'][1]:.2f})",
            *(_rate(row[f"{name}_mean"]) for name in ("blind", "shuffled", "no_op", "expert")),
            row["demonstrations"],
            row["steps"],
            f"{row['cpu_s']:.0f}",
            ", ".join(f"{count} {cause}" for cause, count in row["causes"].items()),
        )
        for row in result["tasks"]
    ]
    heads = ("task", "held (95 %)", "blind", "shuffled", "no-op", "expert", "taught by", "steps", "CPU s", "causes")
    table(heads, rows)
    line(f"page: {Path(result['out']) / 'report.html'}")


def _rate(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"

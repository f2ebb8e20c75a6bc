"""``gensim2 learn``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import click

from gensim2.cli.options import SCENE, Checkpoint, command
from gensim2.cli.output import line, table
from gensim2.cli.typed import Count, File, Folder, Option, count
from gensim2.core.progress import Progress


class Learning:
    """Options of training.

    Attributes:
        policy: Network. keypose predicts poses of the hand, the planner moves between them, and plans teach it. The
            others predict chunks of actions, and episodes teach them.
        minutes: CPU minutes for the data and the training of each policy. If a GPU trains, the rest after the data is
            wall-clock time. Evaluation is not limited.
        multi_task: Train one policy for all TASKS; their sentences tell the tasks apart.
        scenes: Largest number of scenes of each task to plan; of episodes at most 600.
        episodes: Number of episodes of each task to evaluate.
        videos: Number of episodes of each task to film for the page.
        objects: Number of generated objects of each class to learn from, beyond the listed ones.  [default: the objects
            of --instances; without --instances 200, or the training split of real objects]
        generated: Number of generated objects of each class to learn from beside the objects of --assets. Both share
            the time for plans in proportion to their numbers, and each gets up to --scenes.
        verify: Execute the plans that teach a keypose policy in physics, and leave out failed ones; a scene then takes
            ten times as long.
        start: Keypose policy of several tasks that learn made, or the package's. TASKS are added to its tasks, and all
            are measured.
        demonstrations: Run of learn for another policy with the same TASKS, objects and seed. Its demonstrations are
            used, and more are made if their share of --minutes is not spent.
        text: Text encoder of a policy of several tasks: a small one trained with it, CLIP's, or a sentence model's.
            [default: that of --from, else small]
        text_model: Folder or hub name of the weights of --text clip or sentence.  [default: CLIP's on the hub]
        settings: Settings of network and training that differ from the defaults, as YAML; for example encoder:
            pointnext.
        test_instances: Objects to evaluate on.  [default: new if the policy learns from --objects; otherwise, and with
            --from a policy that was trained on listed objects, test if each class has ten or more objects, else new]
    """

    policy: Literal["keypose", "chunk", "transformer", "diffusion", "flow"] = "keypose"
    minutes: Annotated[float, click.FloatRange(0, 1e5, min_open=True)] = 15.0
    multi_task: bool = False
    scenes: Count = 2000
    episodes: Count = 50
    videos: Annotated[int, click.IntRange(0, 1000)] = 3
    objects: Annotated[int | None, count(100_000)] = None
    generated: Annotated[int | None, count(100_000)] = None
    verify: bool = False
    start: Annotated[Checkpoint | None, Option("--from", "DIR|builtin")] = None
    demonstrations: Folder | None = None
    text: Literal["small", "clip", "sentence"] | None = None
    text_model: Annotated[str | None, Option(metavar="FOLDER|NAME")] = None
    settings: Annotated[File | None, Option("--config", "FILE")] = None
    test_instances: Annotated[str | None, Option(metavar="all|train[-K]|test[-K]|new|ID")] = None


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


@command(
    Learning, "control_episodes", "library", "seed", *(each for each in SCENE if each not in ("instances", "redraw")),
    "workers", "device", "resume", show=_show,
)  # fmt: skip
def learn(
    tasks: tuple[str, ...],
    *,
    instances: Annotated[str | None, Option(metavar="all|train[-K]|test[-K]|new|ID")] = None,
    controls: str,
    noise: str | None,
    out: Path | None,
    progress: Progress,
    **given: Any,
) -> dict[str, Any]:
    """Train a policy on tasks, and measure it.

    The policy sees point clouds, the robot's state and a sentence. learn draws scenes of TASKS and plans them (for
    action chunks: simulates and renders them), trains, and evaluates on objects and seeds outside the training, beside
    baselines. --out is a checkpoint, or holds one for each task.

    Args:
        instances: Objects to learn from, in place of --objects.
    """
    from gensim2.data.runfolder import default_run_dir
    from gensim2.perception.noise import read_noise
    from gensim2.policy.evaluating import read_controls
    from gensim2.policy.learning import learn as function

    if instances is not None:
        given["instances"] = instances
    if noise is not None:
        given["noise"] = read_noise(noise)
    where = out or default_run_dir()
    return function(tasks, out=where, controls=read_controls(controls), progress=progress, **given).to_dict()

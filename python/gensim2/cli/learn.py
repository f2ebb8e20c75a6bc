"""Command ``gensim2 learn``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import click

from gensim2.cli.options import SCENE, Checkpoint, command
from gensim2.cli.output import line, table
from gensim2.cli.typed import Count, File, Folder, Option, Real, count
from gensim2.core.progress import Progress


class Learning:
    """Options of training.

    Attributes:
        policy: Type of policy. keypose learns from plans and predicts hand poses, and the planner moves the hand from
            pose to pose. The other types learn from episodes and predict chunks of actions.
        minutes: CPU minutes for data and training of each policy. If a GPU is used, training time is measured as
            wall-clock time. Evaluation is not limited.
        multi_task: Train one policy for all TASKS; an instruction selects the task.
        scenes: Maximum number of scenes of each task to plan; at most 600 for policies that learn from episodes.
        episodes: Number of evaluation episodes of each task.
        videos: Number of episodes of each task to record as video.
        objects: Number of generated objects of each class to train on. These objects are new, so the list of the class
            does not contain them.  [default: train on the objects of --instances. Without --instances: 200 generated
            objects, or the training split of a folder's objects]
        generated: Number of generated objects of each class to train on, in addition to the objects of --assets. The
            planning time is divided between generated objects and objects of --assets in proportion to their numbers.
            The command plans up to --scenes scenes with generated objects and as many with objects of --assets.
        verify: Simulate the plans for a keypose policy, and train only on successful plans. Simulation makes each scene
            take ten times as long.
        start: Multi-task keypose policy to start from: a policy of learn, or builtin. The new policy learns TASKS in
            addition to the tasks of this policy, and all tasks are evaluated.
        demonstrations: Folder of an earlier run of learn with another policy type, but with the same TASKS, objects and
            seed. The new run reuses the demonstrations of the earlier run. The new run also reserves a part of
            --minutes for demonstrations, and makes more demonstrations if some of this time is left.
        text: Text encoder of a multi-task policy: small is trained with the policy, clip is the text encoder of CLIP,
            and sentence is a sentence encoder.  [default: the encoder of --from, else small]
        text_model: Folder or hub name of the weights for --text clip or sentence.  [default: CLIP on the Hugging Face
            hub]
        settings: YAML settings of network and training that differ from the defaults, such as encoder: pointnext.
        test_instances: Objects for the evaluation.  [default: test if the policy, or the policy of --from, was trained
            on listed objects and each class has a test split (ten or more objects); otherwise new]
    """

    policy: Literal["keypose", "chunk", "transformer", "diffusion", "flow"] = "keypose"
    minutes: Annotated[float, Real(0, 1e5, min_open=True)] = 15.0
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
            *(_control(row, name) for name in ("blind", "shuffled", "no_op", "expert")),
            row["demonstrations"],
            row["steps"],
            f"{row['cpu_s']:.0f}",
            ", ".join(f"{count} {cause}" for cause, count in row["causes"].items()),
        )
        for row in result["tasks"]
    ]
    heads = ("task", "held (95 %)", "blind", "shuffled", "no-op", "expert", "demos", "steps", "CPU s", "causes")
    table(heads, rows)
    line(f"report: {Path(result['out']) / 'report.html'}")


def _control(row: dict[str, Any], name: str) -> str:
    mean, episodes = row[f"{name}_mean"], row["control_episodes"]
    return "" if mean is None else f"{round(mean * episodes)} of {episodes}"


@command(
    Learning, "control_episodes", "library", "seed", *(each for each in SCENE if each not in ("instances", "redraw")),
    "engines", "workers", "device", "resume", show=_show,
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
    """Train a policy on tasks, and evaluate it.

    The policy observes point clouds, the robot's state and an instruction. First the command generates scenes of TASKS
    and plans the motions in the scenes. For action-chunk policies, it also simulates the plans and renders the
    episodes. Then it trains the policy. Finally it evaluates the policy and the baselines with objects and seeds that
    were not used in training. The folder --out becomes the checkpoint of the policy. If the command trains a policy for
    each task, --out contains one checkpoint for each task.

    Args:
        instances: Objects to train on; replaces --objects.
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

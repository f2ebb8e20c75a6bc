"""Command ``gensim2 train``."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any

import click

from gensim2.cli.options import command
from gensim2.cli.output import line
from gensim2.cli.typed import Count, File, Folder, Option, Tasks
from gensim2.core.plural import plural
from gensim2.core.progress import Progress
from gensim2.policy.config import OF_KEYPOSES, PolicyConfig, TrainConfig

SETTINGS = {
    each.name: each for kind in (PolicyConfig, TrainConfig) for each in fields(kind) if each.name not in OF_KEYPOSES
}
"""Settings that apply to training on demonstrations; each is an option without a default."""


def _options() -> Iterator[click.Option]:
    for each in SETTINGS.values():
        text, default, word = each.metadata["help"], each.default, each.name.replace("_", "-")
        switch = isinstance(default, bool)
        if default is not None:
            text = f"{text}  [default: {str(default).lower() if switch else default}]"
        if switch:
            yield click.Option([f"--{word}/--no-{word}", each.name], default=None, help=text)
            continue
        choices = [choice for choice in each.metadata["choices"] or () if choice != "keypose"]
        kind = type(default) if isinstance(default, str | float) else int
        yield click.Option([f"--{word}", each.name], type=click.Choice(choices) if choices else kind, help=text)


def _show(result: dict[str, Any]) -> None:
    policy = result["policy"]
    line(f"{policy['encoder']}, {policy['text']}, {policy['head']}: {result['parameters']} weights")
    tasks = ", ".join(result["tasks"])
    kinds = (
        f"{plural(result['demonstrations'], 'demonstration')}, {plural(result['noisy_episodes'], 'episode')} with noise"
    )
    data = f"{plural(result['frames'], 'frame')} ({tasks})"
    line(f"{plural(result['steps'], 'step')} on {data}: {kinds}, {plural(result['relabels'], 'relabel')}")
    line(f"training loss {result['loss']:.4f}: the error on the data; `gensim2 evaluate` measures success")
    line(f"{result['cpu_s']:.1f} s of CPU; checkpoint: {result['folder']}")


@command("workers", "moved_assets", "device", beside=list(_options()), show=_show)
def train(
    *,
    data: Annotated[tuple[Path, ...], Option(metavar="DIR")],
    tasks: Tasks = (),
    config: File | None = None,
    start: Annotated[Path | None, Option("--from", "CHECKPOINT")] = None,
    out: Folder,
    resume: bool,
    dagger: Annotated[int, click.IntRange(0, 100), Option(metavar="ROUNDS")] = 0,
    dagger_episodes: Count = 20,
    progress: Progress,
    **given: Any,
) -> dict[str, Any]:
    """Train a policy on demonstrations.

    The command reads rendered data sets and writes a checkpoint for `gensim2 evaluate`. After Ctrl-C, which saves the
    state, --resume continues the training. On CPUs, the result of a resumed run is bit-identical to the result of an
    uninterrupted run.

    Args:
        data: Rendered data set; can be repeated.
        tasks: Train only on this task; can be repeated.
        config: YAML file with settings.
        start: Continue training from the weights of this policy.
        out: Folder of the checkpoint.
        dagger: Number of DAgger rounds. Each round runs the policy, and labels every visited state with the action that
            the planner would choose. Training then continues with the demonstrations and the new labels. In an episode,
            the planner keeps the strategy and the target pose that it chose at the start.
        dagger_episodes: Number of episodes of each task in each DAgger round.
    """
    from gensim2.policy.training import train as function

    settings = {name: value for name in SETTINGS if (value := given.pop(name)) is not None}
    own: dict[str, Any] = {
        "config": config,
        "start": start,
        "resume": resume,
        "dagger": dagger,
        "dagger_episodes": dagger_episodes,
    }
    result = function(data, tasks=tasks, settings=settings, out=out, progress=progress, **own, **given)
    found: dict[str, Any] = result.to_dict()
    return found

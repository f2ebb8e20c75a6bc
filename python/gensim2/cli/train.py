"""``gensim2 train``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import click

from gensim2.cli import options
from gensim2.cli.output import line, report
from gensim2.policy.config import OF_KEYPOSES, PolicyConfig, TrainConfig

_F = TypeVar("_F", bound=Callable[..., object])


def settings(*kinds: type[PolicyConfig] | type[TrainConfig]) -> Callable[[_F], _F]:
    """Return a decorator that adds an option for every field of the configurations; None where it is not given.

    Fields and the head of keypose policies have none: demonstrations do not teach them.
    """

    def decorate(command: _F) -> _F:
        for kind in reversed(kinds):
            for each in reversed([each for each in fields(kind) if each.name not in OF_KEYPOSES]):
                command = click.option(_flag(each.name, each.default), each.name, **_option(each))(command)
        return command

    return decorate


def given_settings(values: dict[str, Any]) -> dict[str, Any]:
    """Take the settings that were given out of a command's values."""
    names = [each.name for kind in (PolicyConfig, TrainConfig) for each in fields(kind)]
    found = {name: values.pop(name, None) for name in names}
    return {name: value for name, value in found.items() if value is not None}


def _flag(name: str, default: Any) -> str:
    word = name.replace("_", "-")
    return f"--{word}/--no-{word}" if isinstance(default, bool) else f"--{word}"


def _option(each: Any) -> dict[str, Any]:
    text, default = each.metadata["help"], each.default
    if default is not None:
        shown = str(default).lower() if isinstance(default, bool) else default
        text = f"{text}  [default: {shown}]"
    if isinstance(default, bool):
        return {"default": None, "help": text}
    if each.metadata["choices"]:
        choices = [choice for choice in each.metadata["choices"] if choice != "keypose"]
        return {"type": click.Choice(choices), "default": None, "help": text}
    kind = str if isinstance(default, str) else float if isinstance(default, float) else int
    return {"type": kind, "default": None, "help": text}


@click.command("train", cls=options.Command, short_help="Train a policy on demonstrations.")
@click.option(
    "--data",
    type=click.Path(path_type=Path),
    multiple=True,
    required=True,
    metavar="DIR",
    help="Rendered data set; may be given again.",
)
@click.option("--task", "tasks", multiple=True, metavar="NAME", help="Only this one; may be given again.")
@click.option("--config", type=click.Path(path_type=Path), default=None, metavar="FILE", help="Settings as YAML.")
@click.option(
    "--from",
    "start",
    type=click.Path(path_type=Path),
    default=None,
    metavar="CHECKPOINT",
    help="Go on from the weights of a policy, with other data or tasks.",
)
@click.option("--out", type=click.Path(path_type=Path), required=True, metavar="DIR", help="Folder of the checkpoint.")
@options.resume
@click.option(
    "--dagger",
    type=click.IntRange(0, 100),
    default=0,
    show_default=True,
    metavar="ROUNDS",
    help="Roll the policy out, let the planner label the states that it comes to along the episode's own strategy and "
    "pose, and train on with these labels, too.",
)
@click.option(
    "--dagger-episodes",
    type=options.count(),
    default=20,
    show_default=True,
    help="Number of episodes of each task and round of --dagger.",
)
@options.workers
@options.moved_assets
@options.device
@settings(PolicyConfig, TrainConfig)
@options.json_file
def train(
    data: tuple[Path, ...],
    tasks: tuple[str, ...],
    config: Path | None,
    start: Path | None,
    out: Path,
    resume: bool,
    device: str,
    dagger: int,
    dagger_episodes: int,
    workers: int,
    assets: str | None,
    json_file: str | None,
    **given: Any,
) -> None:
    """Train a policy on the demonstrations of rendered data sets; --out is then a checkpoint for `gensim2 evaluate`.

    Ctrl-C writes the state, and --resume goes on, bit for bit on CPUs.
    """
    with report(json_file, _show) as (progress, give):
        from gensim2.policy.training import train as function

        result = function(
            data,
            tasks=tasks,
            config=config,
            settings=given_settings(given),
            start=start,
            out=out,
            resume=resume,
            device=device,
            dagger=dagger,
            dagger_episodes=dagger_episodes,
            workers=workers,
            assets=assets,
            progress=progress,
        )
        give(result.to_dict())


def _show(result: dict[str, Any]) -> None:
    policy = result["policy"]
    line(f"{policy['encoder']}, {policy['text']}, {policy['head']}: {result['parameters']} weights")
    tasks = ", ".join(result["tasks"])
    kinds = f"{result['demonstrations']} demonstrations, {result['noisy_episodes']} episodes with noise"
    line(f"{result['steps']} steps on {result['frames']} frames ({tasks}): {kinds}, {result['relabels']} relabels")
    line(f"loss {result['loss']:.4f}; {result['cpu_s']:.1f} s of CPU; checkpoint: {result['folder']}")

"""Options that several commands share, spelled and explained once."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import click

_F = TypeVar("_F", bound=Callable[..., object])


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class TaskCommand(click.Command):
    """A command with an argument, whose ``--json [FILE]`` does not swallow it.

    ``gensim2 demo --json OpenBox`` means the task, ``gensim2 demo OpenBox --json box.json`` the file: what follows
    ``--json`` is taken for a file if it has a dot or a slash. ``--json=FILE`` takes any name.
    """

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Give ``--json`` its value where the next word is none."""
        settled = list(args)
        for index, word in enumerate(args):
            follower = args[index + 1] if index + 1 < len(args) else ""
            if word == "--json" and not (follower == "-" or "." in follower or "/" in follower):
                settled[index] = "--json=-"
        return super().parse_args(ctx, settled)


seed = click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of everything that is drawn."
)
assets = click.option(
    "--assets",
    metavar="DIR|builtin",
    default=None,
    help="Folder of objects, or 'builtin' for the generated ones.  [default: $GENSIM2_ASSETS, else builtin]",
)
workers = click.option(
    "--workers",
    type=click.IntRange(min=1),
    default=_cores,
    show_default="number of cores",
    help="Simulator processes; the result does not depend on their number.",
)
resume = click.option("--resume", is_flag=True, help="Go on with the run that --out holds.")
time_limit = click.option(
    "--time-limit",
    type=click.FloatRange(min=0, min_open=True),
    default=900.0,
    show_default=True,
    metavar="SECONDS",
    help="After which an episode counts as hung and is tried again in a fresh process.",
)
jobs_per_worker = click.option(
    "--jobs-per-worker",
    type=click.IntRange(min=1),
    default=500,
    show_default=True,
    help="Jobs after which a simulator process is renewed.",
)
video = click.option(
    "--video/--no-video", default=True, show_default=True, help="Film where this machine can draw pictures."
)
json_file = click.option(
    "--json",
    "json_file",
    is_flag=False,
    flag_value="-",
    default=None,
    metavar="[FILE]",
    help="Write the result as JSON to FILE; without FILE to standard output, and all else to standard error.",
)


def out(help_text: str) -> Callable[[_F], _F]:
    """``--out DIR`` with a text of its own."""
    return click.option("--out", type=click.Path(path_type=Path), default=None, metavar="DIR", help=help_text)


def instance(help_text: str) -> Callable[[_F], _F]:
    """``--instance WHICH`` with a text of its own."""
    return click.option("--instance", default=None, metavar="ID|train|test|all|random", help=help_text)

"""Options that several commands share, spelled and explained once."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click
from click.core import ParameterSource

from gensim2.core.cores import usable_cores
from gensim2.core.seeding import LARGEST_SEED

_F = TypeVar("_F", bound=Callable[..., object])


class Command(click.Command):
    """A command with ``--json [FILE]``.

    The word behind ``--json`` is its FILE, whatever it looks like, unless the command would then lack an argument
    that it needs: ``demo OpenBox --json result`` writes to ``result``, ``demo --json OpenBox`` means the task. As the
    last word, or before another option, ``--json`` stands for standard output, as ``--json -`` and ``--json=-`` do.
    """

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Give ``--json`` standard output for its value where the word behind it is needed elsewhere."""
        if "--json" in args and self._lacks_an_argument(ctx, args):
            args = ["--json=-" if word == "--json" else word for word in args]
        return super().parse_args(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Refuse to go on with a run that is not named: a new folder would begin from nothing."""
        if ctx.params.get("resume") and ctx.params.get("out", "") is None:
            raise click.UsageError("--resume goes on with what --out holds: give --out, too")
        return super().invoke(ctx)

    def _lacks_an_argument(self, ctx: click.Context, args: list[str]) -> bool:
        try:
            given, _, _ = self.make_parser(ctx).parse_args(list(args))
        except click.UsageError:  # which parsing in earnest will say
            return False
        needed = [param for param in self.params if isinstance(param, click.Argument) and param.required]
        return any(not isinstance(given.get(param.name), str | tuple) for param in needed)


class _Physics(click.ParamType[str]):
    """A preset, a mixture, or a file of switches; the word of earlier releases is understood and not offered."""

    name = "physics"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the word for the switches."""
        from gensim2.core.errors import InputError  # here and below: `--help` needs none of it
        from gensim2.scenes.physics import physics_name

        try:
            return physics_name(value)
        except InputError as error:
            self.fail(str(error), param, ctx)


class _Robot(click.ParamType[str]):
    """A robot's name, or the Python file or module of one's own, which is loaded: the user names it, no data do."""

    name = "robot"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the word for the robot."""
        from gensim2.robots import load_robot  # here: `--help` needs none of it

        return load_robot(value)


ROBOT = _Robot()


def _use_library(ctx: click.Context, _: click.Parameter, folder: str | None) -> None:
    """Set the variable while the command runs: worker processes inherit it."""
    if folder is None:
        return
    before = os.environ.get("GENSIM2_LIBRARY")
    os.environ["GENSIM2_LIBRARY"] = folder

    def restore() -> None:
        os.environ.pop("GENSIM2_LIBRARY")
        if before is not None:
            os.environ["GENSIM2_LIBRARY"] = before

    ctx.call_on_close(restore)


def _set_redraw(ctx: click.Context, _: click.Parameter, redraw: str | None) -> None:
    """Put the switch into the word of ``--physics``, which stands before it."""
    if redraw is not None:
        from gensim2.scenes.physics import physics_name

        ctx.params["physics"] = physics_name(f"{ctx.params['physics']}+redraw={redraw}")


def count(max_count: int = 1_000_000) -> click.IntRange:
    """A whole number from 1 to ``max_count``: what could never end is refused, not begun."""
    return click.IntRange(1, max_count)


seed = click.option(
    "--seed", type=click.IntRange(0, LARGEST_SEED), default=0, show_default=True, help="Seed of every draw."
)

assets = click.option(
    "--assets",
    metavar="DIR|builtin|ycb",
    default=None,
    help="Folder of objects, 'builtin' for the generated ones, or 'ycb' for ManiSkill's download; a rigid object that "
    "a folder lacks is the generated one.  [default: $GENSIM2_ASSETS, else builtin]",
)

#: No path: of ``builtin`` and ``./builtin`` only the latter is a folder.
checkpoint = click.argument("folder", metavar="DIR|builtin")
moved_assets = click.option(
    "--assets",
    metavar="DIR|ycb",
    default=None,
    help="Where the data set's objects are now, which have to be the same; those of gensim2 do not move.  "
    "[default: where they were]",
)


def _workers(ctx: click.Context, _: click.Parameter, count: int) -> int | None:
    """Return None, one for each CPU of the cluster, where ``--ray`` is given and ``--workers`` is not."""
    default = ctx.get_parameter_source("workers") is ParameterSource.DEFAULT
    return None if default and ctx.params.get("ray") is not None else count


workers = click.option(
    "--workers",
    type=count(1024),
    default=usable_cores,
    show_default="number of cores",
    callback=_workers,
    help="Simulator processes; the result does not depend on their number.",
)
device = click.option(
    "--device",
    default="auto",
    show_default=True,
    metavar="auto|NAME[,NAME...]",
    help="Device of the training by PyTorch's name; several share each batch. auto is the first GPU, else the CPU.",
)
ray = click.option(
    "--ray",
    metavar="local|ADDRESS",
    default=None,
    help="Run on Ray (extra gensim2[ray]): on this machine, or on a cluster whose nodes all have --out at the same "
    "path. --workers is then the most environments at a time, one a CPU where it is not given.",
)
resume = click.option("--resume", is_flag=True, help="Go on with the run that --out holds.")
time_limit = click.option(
    "--time-limit",
    type=click.FloatRange(0, 1e6, min_open=True),
    default=900.0,
    show_default=True,
    metavar="SECONDS",
    help="Time after which an episode counts as hung and is tried again in a fresh process.",
)
jobs_per_worker = click.option(
    "--jobs-per-worker",
    type=count(),
    default=500,
    show_default=True,
    help="Jobs after which a simulator process is renewed.",
)
video = click.option(
    "--video/--no-video", default=True, show_default=True, help="Film where this machine can draw pictures."
)
engine = click.option(
    "--engine",
    type=click.Choice(("sapien", "mujoco")),
    default="sapien",
    show_default=True,
    help="Physics engine: sapien is PhysX with ManiSkill's environments; mujoco (extra gensim2[mujoco]) needs neither "
    "ManiSkill nor PyTorch, and simulates --physics default only.",
)
physics = click.option(
    "--physics",
    type=_Physics(),
    is_eager=True,  # `--redraw` changes it
    default="default",
    show_default=True,
    metavar="default|original|MIXTURE|FILE",
    help="Joint friction, densities, materials, solver, default poses, fingers' drives and redraws: the project's own, "
    "or those of the original GenSim2; or a mixture, as original+gripper=default, or a YAML or JSON file of switches.",
)
redraw = click.option(
    "--redraw",
    type=click.Choice(("none", "placement")),
    default=None,
    expose_value=False,
    callback=_set_redraw,
    help="Whether placements of several objects are drawn again until there is room for all.  [default: as --physics "
    "has it: placement, none of the original]",
)
randomization = click.option(
    "--randomization",
    type=click.Choice(("paper", "paper-half", "wide")),
    default="paper",
    show_default=True,
    help="Ranges of the scenes: the task's own, half of them, or wider ones, with the objects' friction and mass and "
    "the robot's start drawn, too.",
)
robot = click.option(
    "--robot",
    type=ROBOT,
    default="panda",
    show_default=True,
    metavar="NAME|FILE.py",
    help="Robot: panda, fr3, fetch, or a Python file that registers a robot of your own.",
)
open_loop = click.option(
    "--open-loop",
    is_flag=True,
    help="Plan everything at the start of an episode, each step by the first of its strategies that is planned whole, "
    "and never look again.",
)
json_file = click.option(
    "--json",
    "json_file",
    is_flag=False,
    flag_value="-",
    default=None,
    metavar="[FILE]",
    help="Write the result as JSON to FILE, the word that follows; where none follows, or it is needed as an argument, "
    "to standard output, and all else to standard error.",
)


origin = click.option(
    "--origin",
    metavar="NAME",
    default=None,
    help="All tasks of the library that NAME proposed, a designer.  [default: paper, whose suite it is]",
)
library = click.option(
    "--library",
    metavar="DIR|FILE.zip|none",
    default=None,
    expose_value=False,
    callback=_use_library,
    help="Your own tasks beside those of the package.  [default: $GENSIM2_LIBRARY, else a folder among your data]",
)


def out(help_text: str) -> Callable[[_F], _F]:
    """``--out DIR`` with a text of its own."""
    return click.option("--out", type=click.Path(path_type=Path), default=None, metavar="DIR", help=help_text)


#: One name and one meaning wherever a command draws objects; ``--instance`` is the same option.
instances = click.option(
    "--instances",
    "--instance",
    "instances",
    default="all",
    show_default=True,
    metavar="all|train[-K]|test[-K]|new|random|ID",
    help="Objects to draw from; train and test are nine tenths and one, train-1 and test-1 to -9 those of other "
    "tenths, new are generated ones beyond the listed ones, random is one of the listed, drawn by --seed.",
)


def controls(default: str) -> Callable[[_F], _F]:
    """``--controls`` of a policy, by default ``all`` or ``none``, and ``--control-episodes``."""
    which = click.option(
        "--controls",
        default=default,
        show_default=True,
        metavar="all|none|NAME,...",
        help="What a policy is measured beside: blind, shuffled (clouds of other scenes), no-op, expert (the planner).",
    )
    episodes = click.option(
        "--control-episodes",
        type=count(),
        default=30,
        show_default=True,
        help="Number of episodes of each task and control.",
    )
    return _all(which, episodes)


def noise(default: str | None, text: str) -> Callable[[_F], _F]:
    """``--noise`` of depth cameras."""
    return click.option(
        "--noise",
        default=default,
        show_default=default is not None,
        metavar="d435|deployed|white|FILE",
        help=f"{text}; deployed is d435 with errors of calibration and clock, drawn each episode; FILE as gensim2 "
        "robot fit-noise wrote it.",
    )


def _all(*several: Callable[[_F], _F]) -> Callable[[_F], _F]:
    """Several options at once, shown in this order."""

    def decorate(command: _F) -> _F:
        for option in reversed(several):
            command = option(command)
        return command

    return decorate


#: What scenes and episodes follow from: ``gensim2.rollout.config.RolloutArguments``, and the seed.
scenes = _all(seed, assets, instances, engine, physics, redraw, randomization, robot, open_loop)
#: How simulator processes work.
processes = _all(workers, time_limit, jobs_per_worker)

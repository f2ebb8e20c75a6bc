"""Options of the commands that drive an arm, and what they say together."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from gensim2.cli import options
from gensim2.core.errors import InputError

_F = TypeVar("_F", bound=Callable[..., object])


def pixels_of(text: str) -> tuple[int, int]:
    """Width and height of a picture, from ``WIDTHxHEIGHT``.

    Raises:
        InputError: it is no size, or none that a camera has.
    """
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal() and 16 <= int(width) <= 1920 and 16 <= int(height) <= 1200):
        raise InputError(f"{text!r} is no size of a picture", field="--pixels", remedy="as 320x240")
    return int(width), int(height)


def number(name: str, default: float, low: float, high: float, text: str, *, above: bool = False) -> Callable[[_F], _F]:
    """An option that is a number within bounds; ``above``: the lower one is too low itself."""
    kind = click.FloatRange(low, high, min_open=above)
    return click.option(name, type=kind, default=default, show_default=True, help=text)


speed = number("--speed", 0.1, 0.01, 1.0, "Share of the arm's speed; control steps are stretched by as much.")
pixels = click.option("--pixels", default="320x240", show_default=True, metavar="WIDTHxHEIGHT", help="Of a picture.")

#: Of a line: what :class:`gensim2_robot.config.LineConfig` and the scenes follow from.
LINE = (
    click.option(
        "--arm",
        default="simulated",
        show_default=True,
        metavar="simulated|franka:HOST|panda:HOST|ur:HOST|xarm:HOST",
        help="A real one is moved with --move only.",
    ),
    click.option(
        "--cameras",
        default="simulated",
        show_default=True,
        metavar="simulated|software|recording:NAME=DIR|FILE,...|realsense:NAME=SERIAL,...",
        help="Real ones have the names that the policy looks through; software: simulated ones through the RealSense "
        "library; recordings, with dry-run: a run's folder or .mcap, or a RealSense's .db3.",
    ),
    click.option(
        "--policy",
        default=None,
        metavar="DIR|builtin|ws://HOST:PORT",
        help="Checkpoint that gensim2 learn or train left, the one that comes with gensim2, or where gensim2 policy "
        "serve listens.",
    ),
    click.option("--plan", is_flag=True, help="The planner's chain in its place, which sees the true scene."),
    number("--deadline", 0.15, 0.0, 60.0, "Seconds within which an action must come from a server.", above=True),
    speed,
    number("--margin", 0.1, 0.0, 1.0, "Rad that joints keep from the ends of their range."),
    number("--force", 140.0, 1.0, 1000.0, "Newtons that may press on the arm."),
    pixels,
    number("--rate", 10.0, 1.0, 60.0, "Pictures a second of each camera."),
    options.noise("d435", "Of the simulated cameras"),
    click.option(
        "--calibration",
        type=click.Path(path_type=Path),
        default=None,
        metavar="FILE",
        help="Where the cameras are, as gensim2 robot calibrate wrote it.",
    ),
    number("--calibration-days", 7.0, 0.0, 1e4, "Age from which on it is refused.", above=True),
    click.option(
        "--real-time/--simulated-clock",
        default=None,
        help="Run the devices in processes of their own by the machine's clock, or all of them in one process by a "
        "clock that waits for each, so that every run is the same.  [default: --simulated-clock where arm and cameras "
        "are simulated]",
    ),
    options.library,
    options.seed,
    options.assets,
    options.instances,
    options.engine,
    options.physics,
    options.randomization,
    options.robot,
)
#: Of a command that moves real arms.
MOVE = (click.option("--move", is_flag=True, help="Move a real arm, once a person at the terminal has said so."),)
#: Of a page in the browser.
PAGE = (
    click.option("--view", is_flag=True, help="Show clouds, robot, next actions and clocks in the browser."),
    click.option("--port", type=click.IntRange(1, 65535), default=8080, show_default=True, help="Of --view's page."),
)
#: Of a run.
RUN = (
    number("--minutes", 1.0, 0.0, 1e4, "Episodes are repeated until this time is over.", above=True),
    click.option("--log/--no-log", "logged", default=True, show_default=True, help="Write everything down, as MCAP."),
    options.out("Folder of the log.  [default: runs/robot-<date>-<time>]"),
)


def all_of(*groups: tuple[Callable[[Any], Any], ...]) -> Callable[[_F], _F]:
    """Options of several groups, shown in this order."""

    def decorate(command: _F) -> _F:
        for option in reversed([option for group in groups for option in group]):
            command = option(command)
        return command

    return decorate


def line_of(given: dict[str, Any]) -> dict[str, Any]:
    """Return the keywords of a line from a command's values.

    A simulated arm with simulated cameras goes by the simulated clock, unless ``--real-time`` is given: by the clock of
    the machine one other busy process is enough for the watch to hold the arm.

    Raises:
        UsageError: both are given, or neither.
    """
    if given.pop("plan") == (given["policy"] is not None):
        raise click.UsageError("Give either --plan or --policy DIR.")
    real = given.pop("real_time")
    simulated = given["arm"] == given["cameras"] == "simulated" if real is None else not real
    return {**given, "pixels": pixels_of(given["pixels"]), "simulated_clock": simulated}


def moves(given: dict[str, Any], move: bool) -> bool:
    """Whether a line may move its arm: a simulated one always, a real one when a person has said so.

    Raises:
        InputError: there is no such arm, or no terminal at which a person could.
    """
    from gensim2_robot.config import LineConfig

    # What cannot be used is said before a person is asked.
    if LineConfig(arm=given["arm"], cameras=given["cameras"], policy=given["policy"]).is_simulated:
        return True
    if not move:
        click.echo("a dry run: nothing is sent to the arm; --move moves it", err=True)
        return False
    if not sys.stdin.isatty():
        raise InputError("a person at a terminal says so", field="--move", remedy="leave it out: a dry run")
    click.echo(
        "This is a software stop, not safety-rated. Is the emergency stop within reach, was it tried today, and is "
        "nobody within the arm's reach?",
        err=True,
    )
    word = click.prompt(f"Write the arm's name, {given['arm']}, to move it", default="", show_default=False, err=True)
    if word.strip() != given["arm"]:
        raise InputError("was not confirmed; nothing has moved", field="--move")
    return True

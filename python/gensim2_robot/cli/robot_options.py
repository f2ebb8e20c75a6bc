"""Define the options of commands that control an arm, and check their combinations."""

from __future__ import annotations

import sys
from typing import Annotated, Any

import click

from gensim2.cli.options import SCENE
from gensim2.cli.typed import File, Folder, Option, Real
from gensim2.core.errors import InputError

Pixels = Annotated[str, Option(metavar="WIDTHxHEIGHT")]
Share = Annotated[float, Real(0.01, 1.0)]

#: Options that select a scene, in addition to the options of :class:`LineOptions`, without ``--redraw``.
SCENES = ("library", "seed", *(each for each in SCENE if each != "redraw"))


class LineOptions:
    """Options of an arm, its cameras and its controller.

    Attributes:
        arm: Arm to control; a real arm moves only with --move.
        cameras: Cameras to use. Real cameras need the names of the policy's cameras. "software" passes simulated
            pictures through the RealSense library. "recording" replays the log folder or .mcap file of a run, or a
            RealSense .db3 file, and works only with dry-run.
        policy: Checkpoint from gensim2 learn or train, "builtin", or the URL of gensim2 policy serve.
        plan: Use the planner instead of a policy.
        scene_source: Source of the planner's scene. true is the state of the simulator, so real arms need another
            source. perceived is the estimator of the package, and DIR is an estimator made by gensim2 perceive train.
            With an estimator, the planner gets estimates from the cameras' point clouds, and uses them to decide when
            the task is done.
        deadline: Time limit for an answer from a policy server, in seconds.
        speed: Fraction of the arm's maximum speed; control steps take longer in proportion.
        margin: Minimum distance of joints from their limits, in rad.
        force: Maximum contact force on the arm, in newtons.
        pixels: Width and height of a picture.
        rate: Pictures per second of each camera.
        noise: Depth noise of the simulated cameras; same values as --noise of gensim2 render.
        calibration: Calibration file from gensim2 robot calibrate.
        calibration_days: Maximum age of the calibration, in days.
        real_time: Use the machine's clock and a process for each device (--real-time), or a simulated clock and one
            process for all devices. A simulated clock waits for each device, so runs are reproducible.  [default:
            --simulated-clock if arm and cameras are simulated]
    """

    arm: Annotated[str, Option(metavar="simulated|franka:HOST|panda:HOST|ur:HOST|xarm:HOST")] = "simulated"
    cameras: Annotated[
        str, Option(metavar="simulated|software|recording:NAME=DIR|FILE,...|realsense:NAME=SERIAL,...")
    ] = "simulated"
    policy: Annotated[str | None, Option(metavar="DIR|builtin|ws://HOST:PORT")] = None
    plan: bool = False
    scene_source: Annotated[str, Option("--scene", "true|perceived|DIR")] = "true"
    deadline: Annotated[float, Real(0.0, 60.0, min_open=True)] = 0.15
    speed: Share = 0.1
    margin: Annotated[float, Real(0.0, 1.0)] = 0.1
    force: Annotated[float, Real(1.0, 1000.0)] = 140.0
    pixels: Pixels = "320x240"
    rate: Annotated[float, Real(1.0, 60.0)] = 10.0
    noise: Annotated[str, Option(metavar="d435|deployed|white|FILE")] = "d435"
    calibration: File | None = None
    calibration_days: Annotated[float, Real(0.0, 1e4, min_open=True)] = 7.0
    real_time: Annotated[bool | None, Option("--real-time/--simulated-clock")] = None


class Move:
    """Options of commands that move real arms.

    Attributes:
        move: Move a real arm, after a person at the terminal has confirmed the motion.
    """

    move: bool = False


class Port:
    """Options of a command that can show a web page.

    Attributes:
        port: Port of the web page.
    """

    port: Annotated[int, click.IntRange(1, 65535)] = 8080


class ViewOptions:
    """Options of commands that can show a web page during the run.

    Attributes:
        view: Show point clouds, the robot, the next actions and the delays in the browser.
    """

    view: bool = False


class Minutes:
    """Options of commands that repeat episodes.

    Attributes:
        minutes: Time limit of the run in minutes of the arm's clock, which is simulated time for a simulated arm
            without --real-time. An episode that is not finished by then is not counted.
    """

    minutes: Annotated[float, Real(0.0, 1e4, min_open=True)] = 1.0


class LogOptions:
    """Options of the log of a run.

    Attributes:
        logged: Write an MCAP log of the run.
        out: Folder of the log.  [default: runs/robot-<date>-<time>]
    """

    logged: Annotated[bool, Option("--log/--no-log")] = True
    out: Folder | None = None


def pixels_of(text: str) -> tuple[int, int]:
    """Return width and height of an image, from ``WIDTHxHEIGHT``.

    Raises:
        InputError: the text is not a size, or cameras do not support the size.
    """
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal() and 16 <= int(width) <= 1920 and 16 <= int(height) <= 1200):
        raise InputError(f"{text!r} is not the size of a picture", field="--pixels", remedy="for example 320x240")
    return int(width), int(height)


def line_of(given: dict[str, Any]) -> dict[str, Any]:
    """Convert the option values of a command into arguments of the control loop.

    A simulated arm with simulated cameras uses the simulated clock unless ``--real-time`` is given. With the machine's
    clock, another busy process could make the watchdog stop the arm.

    Raises:
        UsageError: both or neither of ``--plan`` and ``--policy`` are given.
    """
    if given.pop("plan") == (given["policy"] is not None):
        raise click.UsageError("Give either --plan or --policy DIR.")
    real = given.pop("real_time")
    simulated = given["arm"] == given["cameras"] == "simulated" if real is None else not real
    return {**given, "pixels": pixels_of(given["pixels"]), "simulated_clock": simulated}


def moves(given: dict[str, Any], move: bool) -> bool:
    """Return whether the arm may move: a simulated arm always, a real arm after a person has confirmed the motion.

    Raises:
        InputError: the arm is unknown, or there is no terminal for the confirmation.
    """
    from gensim2_robot.config import LineConfig

    # Creating a LineConfig checks the arguments, so wrong arguments are reported before the person confirms the motion.
    names = ("arm", "cameras", "policy", "scene_source")
    if LineConfig(**{name: given[name] for name in names}).is_simulated:
        return True
    if not move:
        click.echo("This is a dry run: no command is sent to the arm. Give --move to move the arm.", err=True)
        return False
    if not sys.stdin.isatty():
        wrong = "a person must confirm the motion at a terminal"
        raise InputError(wrong, field="--move", remedy="leave the option out for a dry run")
    click.echo(
        "This program stops the arm by software only, and this stop is not safety-rated. Is the emergency stop within "
        "reach? Did you test the emergency stop today? Is everybody outside the arm's reach?",
        err=True,
    )
    word = click.prompt(f"Write the arm's name, {given['arm']}, to move it", default="", show_default=False, err=True)
    if word.strip() != given["arm"]:
        raise InputError("was not confirmed, so the arm has not moved", field="--move")
    return True

"""``gensim2 robot``."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.main import FOUND_WRONG
from gensim2.cli.output import line, report, table
from gensim2.cli.signals import Stopped
from gensim2.deploy.faults import FAULTS
from gensim2.errors import InputError


@click.group("robot")
def robot() -> None:
    """Drive an arm through limits, a watch and a log. Read the first page of docs/robot.md before any real one."""


def _pixels(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal() and 16 <= int(width) <= 1920 and 16 <= int(height) <= 1200):
        raise InputError(f"{text!r} is no size of a picture", field="--pixels", remedy="as 320x240")
    return int(width), int(height)


def _devices(command: Any) -> Any:
    """Build the devices of a robot line from the command's options."""
    for option in reversed(
        (
            click.argument("task"),
            click.option("--arm", type=click.Choice(("simulated",)), default="simulated", show_default=True),
            click.option("--cameras", type=click.Choice(("simulated",)), default="simulated", show_default=True),
            click.option(
                "--policy",
                default=None,
                metavar="DIR|ws://HOST:PORT",
                help="Checkpoint that gensim2 learn or train left, or where gensim2 policy serve listens.",
            ),
            click.option(
                "--deadline",
                type=click.FloatRange(0.0, 60.0, min_open=True),
                default=0.15,
                show_default=True,
                help="Seconds within which an action must come from a server.",
            ),
            click.option("--plan", is_flag=True, help="The planner's chain in its place, which sees the true scene."),
            click.option(
                "--speed",
                type=click.FloatRange(0.01, 1.0),
                default=0.1,
                show_default=True,
                help="Share of the arm's speed; control steps are stretched by as much.",
            ),
            click.option(
                "--margin",
                type=click.FloatRange(0.0, 1.0),
                default=0.1,
                show_default=True,
                help="Rad that joints keep from the ends of their range.",
            ),
            click.option(
                "--force",
                type=click.FloatRange(1.0, 1000.0),
                default=140.0,
                show_default=True,
                help="Newtons that may press on the arm.",
            ),
            click.option(
                "--minutes",
                type=click.FloatRange(0, 1e4, min_open=True),
                default=1.0,
                show_default=True,
                help="Episodes are repeated until this time is over.",
            ),
            click.option(
                "--pixels", default="320x240", show_default=True, metavar="WIDTHxHEIGHT", help="Of a picture."
            ),
            click.option(
                "--rate",
                type=click.FloatRange(1.0, 60.0),
                default=10.0,
                show_default=True,
                help="Pictures a second of each simulated camera.",
            ),
            click.option(
                "--noise",
                default="d435",
                show_default=True,
                metavar="d435|white|FILE",
                help="Of the simulated cameras; FILE as gensim2 robot fit-noise wrote it.",
            ),
            click.option(
                "--calibration",
                type=click.Path(path_type=Path),
                default=None,
                metavar="FILE",
                help="Where the cameras are, as gensim2 robot calibrate wrote it.",
            ),
            click.option(
                "--calibration-days",
                type=click.FloatRange(0.0, 1e4, min_open=True),
                default=7.0,
                show_default=True,
                help="Age from which on it is refused.",
            ),
            click.option(
                "--log/--no-log",
                "logged",
                default=True,
                show_default=True,
                help="Write everything down, as MCAP files.",
            ),
            options.out("Folder of the log.  [default: runs/robot-<date>-<time>]"),
            click.option(
                "--simulated-clock", is_flag=True, help="One process, by a clock that waits: the same run every time."
            ),
            options.library,
            options.seed,
            options.assets,
            options.instances,
            options.physics,
            options.randomization,
            options.robot,
            options.json_file,
        )
    ):
        command = option(command)
    return command


@robot.command("run", cls=options.Command, short_help="Run episodes on an arm until the time is over.")
@click.option(
    "--fault",
    "faults",
    multiple=True,
    metavar="NAME@SECONDS",
    help=f"Let a simulated device fail from then on: {', '.join(FAULTS)}.",
)
@_devices
@click.pass_context
def run(ctx: click.Context, /, json_file: str | None, faults: tuple[str, ...], **given: Any) -> None:
    """Let a policy or a plan do TASK again and again, and say what came of it.

    A software stop, not safety-rated. Where a watch holds the arm, a person at the terminal resumes (r) or stops (any
    other key); without one the run ends there. Ctrl-C and SIGTERM stop the arm first. The JSON is written however it
    ends. Ends with 1 where the arm was held or stopped.
    """
    from gensim2.deploy.faults import Fault

    _run(ctx, json_file, given, faults=[Fault.parse(each) for each in faults])


@robot.command("dry-run", cls=options.Command, short_help="The same, with nothing sent to the arm.")
@_devices
@click.pass_context
def dry_run(ctx: click.Context, /, json_file: str | None, **given: Any) -> None:
    """Look, think, check every limit and write everything down, as gensim2 robot run does, and send nothing."""
    _run(ctx, json_file, given, dry=True)


def _run(ctx: click.Context, json_file: str | None, given: dict[str, Any], **beside: Any) -> None:
    del given["arm"], given["cameras"]  # there is one of each so far
    pixels, logged, out = _pixels(given.pop("pixels")), given.pop("logged"), given.pop("out")
    if given.pop("plan") == (given["policy"] is not None):
        raise click.UsageError("Give either --plan or --policy DIR.")
    folder = None
    if logged:
        folder = out or Path("runs") / time.strftime("robot-%Y%m%d-%H%M%S")
    with report(json_file, _show) as (progress, give):
        from gensim2.deploy.keys import Keys
        from gensim2.deploy.log import prune_runs
        from gensim2.deploy.run import run as function

        if folder is not None and out is None:
            prune_runs(folder.parent)
        with Keys() as keys:
            result = function(**given, **beside, pixels=pixels, log=folder, keys=keys, progress=progress)
        give(result)
    if result["interrupted"]:
        number = signal.Signals[result["interrupted"][0]]
        raise KeyboardInterrupt if number is signal.SIGINT else Stopped(number)
    if result["state"] != "idle":
        ctx.exit(FOUND_WRONG)


def _show(result: dict[str, Any]) -> None:
    line(f"{result['state']}: {result['reason']}")
    success = "" if result["success"] is None else f", {result['success']:.2f} held"
    line(f"{result['episodes']} episodes{success}; {result['limits_passed']} commands passed a limit")
    heads = ("ms", "median", "99th percentile", "worst")
    names = {
        "periods_ms": "period",
        "overrun_ms": "overrun",
        "clouds_ms": "pictures to cloud",
        "picture_age_ms": "age of the pictures then",
        "acting_ms": "controller",
    }
    table(
        heads,
        [(said, *(_number(result[name][key]) for key in ("p50", "p99", "worst"))) for name, said in names.items()],
    )
    for halt in result["halts"]:
        line(f"{halt['state']} within {_number(halt['detected_to_stopped_ms'])} ms: {halt['reason']}")
    if result["log"] is not None:
        line(f"log: {result['log']}")


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.1f}"


@robot.command("calibrate", cls=options.Command, short_help="Find out where the cameras are.")
@click.argument("task", default="CloseBox")
@click.option(
    "--from",
    "log",
    type=click.Path(path_type=Path),
    default=None,
    metavar="DIR",
    help="Log of a run in which the arm stood in several poses; without, a simulated arm is moved.",
)
@click.option(
    "--board", default=None, metavar="COLUMNSxROWS:SQUARE:MARKER", help="ChArUco board in the log's pictures."
)
@click.option("--carried", is_flag=True, help="With a board: it stands still, and the cameras hang on the arm.")
@click.option("--poses", type=click.IntRange(4, 12), default=8, show_default=True, help="That the arm is moved to.")
@click.option(
    "--degrees", type=click.FloatRange(0, 60), default=15.0, show_default=True, help="Off, of the first guess."
)
@click.option("--metres", type=click.FloatRange(0, 1), default=0.1, show_default=True, help="Off, of the first guess.")
@click.option("--pixels", default="320x240", show_default=True, metavar="WIDTHxHEIGHT", help="Of a picture.")
@click.option("--speed", type=click.FloatRange(0.01, 1.0), default=0.1, show_default=True, help="Share of the arm's.")
@options.out("File to write.  [default: calibration.json]")
@options.seed
@options.assets
@options.robot
@options.json_file
@click.pass_context
def calibrate(ctx: click.Context, /, log: Path | None, json_file: str | None, **given: Any) -> None:
    """Find the cameras by the robot itself: its meshes against the depth, in several arm poses, some held out to judge.

    A simulated arm is moved before the objects of TASK, its cameras' poses are forgotten as far as --degrees and
    --metres say; or poses and pictures are those of a log. Ends with 1, and writes nothing, where a camera does not
    converge.
    """
    from gensim2.deploy.calibration.board import Board

    out, pixels = given.pop("out") or Path("calibration.json"), _pixels(given.pop("pixels"))
    board = None if given["board"] is None else Board.parse(given["board"])
    carried = given.pop("carried")
    del given["board"]
    if log is None and (board is not None or carried):
        raise click.UsageError("A board is in the pictures of a log: give --from DIR.")
    if carried and board is None:
        raise click.UsageError("Cameras on the arm see little of it: give --board.")
    with report(json_file, _show_calibration) as (progress, give):
        from gensim2.deploy.calibration.run import calibrate_log, calibrate_simulated

        if log is not None:
            found = calibrate_log(log, out, board=board, carried=carried, seed=given["seed"])
        else:
            found = calibrate_simulated(out=out, pixels=pixels, progress=progress, **given)
        give(found)
    if not found["converged"]:
        ctx.exit(FOUND_WRONG)


def _show_calibration(result: dict[str, Any]) -> None:
    table(
        ("camera", "fitted, mm", "held out, mm", "trouble"),
        [
            (name, _number(each.get("residual_mm")), _number(each.get("held_out_mm")), each["trouble"] or "")
            for name, each in result["cameras"].items()
        ],
    )
    line(f"{result['poses']} poses; " + (f"file: {result['file']}" if result["file"] else "nothing was written"))


@robot.command("fit-noise", cls=options.Command, short_help="Fit the depth noise to recordings.")
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
@options.out("File to write.  [default: noise.json]")
@options.json_file
def fit_noise(folder: Path, out: Path | None, json_file: str | None) -> None:
    """Fit the parameters of the depth noise to the pictures in the log DIR that were taken while its arm stood.

    The file is what --noise of gensim2 render and of gensim2 robot run takes.
    """
    with report(json_file, _show_noise) as (_, give):
        from gensim2.deploy.fit_noise import fit_log

        give(fit_log(folder, out or Path("noise.json")))


def _show_noise(result: dict[str, Any]) -> None:
    from gensim2.deploy.fit_noise import shown

    table(("parameter", "value", "pixels that tell"), shown(result["noise"], result["told"]))
    line(f"{result['recordings']} recordings; file: {result['file']}")


@robot.command("replay", cls=options.Command, short_help="Make a log's clouds and inputs anew, and compare.")
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
@options.json_file
@click.pass_context
def replay(ctx: click.Context, /, folder: Path, json_file: str | None) -> None:
    """Make every cloud and every input of the log in DIR anew from its pictures and joints, and compare byte for byte.

    Ends with 1 where anything differs.
    """
    with report(json_file, _show_replay) as (_, give):
        from gensim2.deploy.replay import replay as function

        found = function(folder)
        give({"schema_version": 1, **found.to_dict()})
    if found.different:
        ctx.exit(FOUND_WRONG)


def _show_replay(result: dict[str, Any]) -> None:
    line(f"{result['questions']} questions, {result['clouds']} clouds: {len(result['different'])} arrays differ")
    for name in result["different"][:20]:
        line(name)
    if result["missing"]:
        line(f"{result['missing']} questions ask for pictures that are gone")


@robot.command("check", cls=options.Command, short_help="Say whether everything is there to drive an arm.")
@options.robot
@options.json_file
@click.pass_context
def check(ctx: click.Context, /, json_file: str | None, **given: Any) -> None:
    """Look at what a run needs: packages, the clock, room for the log, the robot's start; ends with 1 without."""
    with report(json_file, _show_check) as (_, give):
        from gensim2.deploy.check import check as function

        found = function(given["robot"], Path.cwd())
        give({"schema_version": 1, "checks": found, "cores": os.cpu_count()})
    if not all(each["fine"] for each in found):
        ctx.exit(FOUND_WRONG)


def _show_check(result: dict[str, Any]) -> None:
    table(
        ("check", "", "found"),
        [(each["name"], "ok" if each["fine"] else "NO", each["found"]) for each in result["checks"]],
    )

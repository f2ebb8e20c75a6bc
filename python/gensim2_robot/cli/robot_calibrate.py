"""``gensim2 robot calibrate`` and ``gensim2 robot fit-noise``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.main import FOUND_WRONG
from gensim2.cli.output import line, number, report, table
from gensim2_robot.cli.robot_options import pixels, pixels_of, speed


@click.command("calibrate", cls=options.Command, short_help="Find out where the cameras are.")
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
@pixels
@speed
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
    from gensim2_robot.calibration.board import Board

    out = given.pop("out") or Path("calibration.json")
    given["pixels"] = pixels_of(given["pixels"])
    board = None if given["board"] is None else Board.parse(given["board"])
    carried = given.pop("carried")
    del given["board"]
    if log is None and (board is not None or carried):
        raise click.UsageError("A board is in the pictures of a log: give --from DIR.")
    if carried and board is None:
        raise click.UsageError("Cameras on the arm see little of it: give --board.")
    with report(json_file, _show_calibration) as (progress, give):
        from gensim2_robot.calibration.run import calibrate_log, calibrate_simulated

        if log is not None:
            found = calibrate_log(log, out, board=board, carried=carried, seed=given["seed"])
        else:
            found = calibrate_simulated(out=out, progress=progress, **given)
        give(found)
    if not found["converged"]:
        ctx.exit(FOUND_WRONG)


def _show_calibration(result: dict[str, Any]) -> None:
    table(
        ("camera", "fitted, mm", "held out, mm", "trouble"),
        [
            (name, number(each.get("residual_mm")), number(each.get("held_out_mm")), each["trouble"] or "")
            for name, each in result["cameras"].items()
        ],
    )
    line(f"{result['poses']} poses; " + (f"file: {result['file']}" if result["file"] else "nothing was written"))


@click.command("fit-noise", cls=options.Command, short_help="Fit the depth noise to recordings.")
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
@options.out("File to write.  [default: noise.json]")
@options.json_file
def fit_noise(folder: Path, out: Path | None, json_file: str | None) -> None:
    """Fit the parameters of the depth noise to the pictures in the log DIR that were taken while its arm stood.

    The file is what --noise of gensim2 render and of gensim2 robot run takes.
    """
    with report(json_file, _show_noise) as (_, give):
        from gensim2_robot.fit_noise import fit_log

        give(fit_log(folder, out or Path("noise.json")))


def _show_noise(result: dict[str, Any]) -> None:
    from gensim2_robot.fit_noise import shown

    table(("parameter", "value", "pixels that tell"), shown(result["noise"], result["told"]))
    line(f"{result['recordings']} recordings; file: {result['file']}")

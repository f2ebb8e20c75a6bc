"""``gensim2 robot calibrate`` and ``gensim2 robot fit-noise``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import click

from gensim2.cli.options import Ending, command
from gensim2.cli.output import line, number, table
from gensim2.cli.typed import Folder, Option
from gensim2.core.progress import Progress
from gensim2_robot.cli.robot_options import Pixels, Share, pixels_of


def _show_calibration(result: dict[str, Any]) -> None:
    table(
        ("camera", "fitted, mm", "held out, mm", "trouble"),
        [
            (name, number(each.get("residual_mm")), number(each.get("held_out_mm")), each["trouble"] or "")
            for name, each in result["cameras"].items()
        ],
    )
    line(f"{result['poses']} poses; " + (f"file: {result['file']}" if result["file"] else "nothing was written"))


def _show_noise(result: dict[str, Any]) -> None:
    from gensim2_robot.fit_noise import shown

    table(("parameter", "value", "pixels that tell"), shown(result["noise"], result["told"]))
    line(f"{result['recordings']} recordings; file: {result['file']}")


@command("seed", "assets", "robot", show=_show_calibration)
def calibrate(
    task: str = "CloseBox",
    *,
    log: Annotated[Path | None, Option("--from", "DIR")] = None,
    board: Annotated[str | None, Option(metavar="COLUMNSxROWS:SQUARE:MARKER")] = None,
    carried: bool = False,
    poses: Annotated[int, click.IntRange(4, 12)] = 8,
    degrees: Annotated[float, click.FloatRange(0, 60)] = 15.0,
    metres: Annotated[float, click.FloatRange(0, 1)] = 0.1,
    pixels: Pixels = "320x240",
    speed: Share = 0.1,
    out: Folder = Path("calibration.json"),
    progress: Progress,
    **given: Any,
) -> dict[str, Any] | Ending:
    """Find the poses of the cameras.

    Compares the robot's meshes with the depth in several arm poses, some of which are held out for validation. A
    simulated arm is moved before the objects of TASK, and the camera poses start with the errors of --degrees and
    --metres; or poses and pictures come from a log. Ends with exit code 1, and writes nothing, if a camera does not
    converge.

    Args:
        log: Log of a run in which the arm stood in several poses.  [default: a simulated arm is moved]
        board: ChArUco board in the log's pictures.
        carried: The cameras are mounted on the arm, and the --board stands still.
        poses: Number of poses that the arm moves to.
        degrees: Rotation error of the first guess in degrees.
        metres: Position error of the first guess in metres.
        pixels: Size of a picture.
        speed: Fraction of the arm's speed; control steps take longer in proportion.
        out: File to write.
    """
    from gensim2_robot.calibration.board import Board
    from gensim2_robot.calibration.run import calibrate_log, calibrate_simulated

    size, read = pixels_of(pixels), None if board is None else Board.parse(board)
    if log is None and (read is not None or carried):
        raise click.UsageError("A board is in the pictures of a log: give --from DIR.")
    if carried and read is None:
        raise click.UsageError("Cameras on the arm see little of it: give --board.")
    if log is not None:
        found = calibrate_log(log, out, board=read, carried=carried, seed=given["seed"])
    else:
        moved: dict[str, Any] = {"poses": poses, "degrees": degrees, "metres": metres, "pixels": size, "speed": speed}
        found = calibrate_simulated(task, out=out, progress=progress, **moved, **given)
    return found if found["converged"] else Ending(found)


@command(name="fit-noise", show=_show_noise)
def fit_noise(folder: Annotated[Path, Option(metavar="DIR")], *, out: Folder = Path("noise.json")) -> dict[str, Any]:
    """Fit the depth noise to recordings.

    Fits the parameters of the noise to the pictures in the log DIR that were taken while its arm stood still. The file
    can be used as --noise of gensim2 render and of gensim2 robot run.

    Args:
        out: File to write.
    """
    from gensim2_robot.fit_noise import fit_log

    return fit_log(folder, out)

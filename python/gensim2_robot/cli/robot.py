"""Define the commands of ``gensim2 robot``."""

from __future__ import annotations

import contextlib
import shlex
import signal
import time
from pathlib import Path
from typing import Annotated, Any, Literal

import click

from gensim2.cli.options import Ending, command
from gensim2.cli.output import line, number, table
from gensim2.cli.typed import Folder, Option, Real, count
from gensim2.core.cores import usable_cores
from gensim2.core.errors import InputError, Stopped
from gensim2.core.plural import plural
from gensim2.core.progress import ConsoleProgress, Progress
from gensim2_robot.cli.robot_options import (
    SCENES,
    LineOptions,
    LogOptions,
    Minutes,
    Move,
    Pixels,
    Port,
    Share,
    ViewOptions,
    line_of,
    moves,
    pixels_of,
)


def _show_calibration(result: dict[str, Any]) -> None:
    table(
        ("camera", "fitted, mm", "held out, mm", "trouble"),
        [
            (name, number(each.get("residual_mm")), number(each.get("held_out_mm")), each["trouble"] or "")
            for name, each in result["cameras"].items()
        ],
    )
    line(
        f"{plural(result['poses'], 'pose')}; "
        + (f"file: {result['file']}" if result["file"] else "nothing was written")
    )


def _show_noise(result: dict[str, Any]) -> None:
    from gensim2_robot.fit_noise import shown

    table(("parameter", "value", "pixels that tell"), shown(result["noise"], result["told"]))
    line(f"{plural(result['recordings'], 'recording')}; file: {result['file']}")


@command("seed", "assets", "robot", show=_show_calibration)
def calibrate(
    task: str = "CloseBox",
    *,
    log: Annotated[Path | None, Option("--from", "DIR")] = None,
    board: Annotated[str | None, Option(metavar="COLUMNSxROWS:SQUARE:MARKER")] = None,
    carried: bool = False,
    poses: Annotated[int, click.IntRange(4, 12)] = 8,
    degrees: Annotated[float, Real(0, 60)] = 15.0,
    metres: Annotated[float, Real(0, 1)] = 0.1,
    pixels: Pixels = "320x240",
    speed: Share = 0.1,
    out: Folder = Path("calibration.json"),
    progress: Progress,
    **given: Any,
) -> dict[str, Any] | Ending:
    """Calibrate the poses of the cameras.

    The command fits the camera poses so that depth pictures of the arm match the robot's meshes. The pictures show the
    arm in several poses, and some of these arm poses are used only to validate the fit. The pictures come from a log,
    or from a simulated arm in a scene of TASK. With a simulated arm, the fit starts from camera poses with errors of
    --degrees and --metres. If the fit of a camera does not converge, the command writes no file and exits with code 1.

    Args:
        log: Log of a run in which the arm was at rest in several poses.  [default: move a simulated arm]
        board: ChArUco board in the log's pictures.
        carried: Calibrate the cameras that are mounted on the arm. This needs --board, and the board must not move.
        poses: Number of poses that the arm moves to.
        degrees: Rotation error of a simulated camera's initial pose, in degrees.
        metres: Position error of a simulated camera's initial pose, in metres.
        pixels: Width and height of a picture.
        speed: Fraction of the arm's maximum speed; control steps take longer in proportion.
        out: Calibration file to write.
    """
    from gensim2_robot.calibration.board import Board
    from gensim2_robot.calibration.run import calibrate_log, calibrate_simulated

    size, read = pixels_of(pixels), None if board is None else Board.parse(board)
    if log is None and (read is not None or carried):
        raise click.UsageError("--board needs images from a log: give --from DIR.")
    if carried and read is None:
        raise click.UsageError("Cameras on the arm see too little of the arm's meshes: give --board.")
    if log is not None:
        found = calibrate_log(log, out, board=read, carried=carried, seed=given["seed"])
    else:
        moved: dict[str, Any] = {"poses": poses, "degrees": degrees, "metres": metres, "pixels": size, "speed": speed}
        found = calibrate_simulated(task, out=out, progress=progress, **moved, **given)
    return found if found["converged"] else Ending(found)


@command(name="fit-noise", show=_show_noise)
def fit_noise(folder: Annotated[Path, Option(metavar="DIR")], *, out: Folder = Path("noise.json")) -> dict[str, Any]:
    """Fit the depth noise model to a log.

    The command uses those pictures in the log DIR that were taken while the arm was at rest. The resulting file can be
    given as --noise to gensim2 render and gensim2 robot run.

    Args:
        out: File to write.
    """
    from gensim2_robot.fit_noise import fit_log

    return fit_log(folder, out)


def _show_trials(result: dict[str, Any]) -> None:
    rows = [
        (
            row["task"],
            row["policy"],
            row["trials"],
            "" if row["rate"] is None else f"{row['rate']:.2f}",
            "{:.2f} to {:.2f}".format(*row["interval"]),
            ", ".join(f"{count} {cause}" for cause, count in row["causes"].items()),
        )
        for row in result["rows"]
    ]
    table(("task", "policy", "trials", "succeeded", "95 %", "causes"), rows)
    line(f"table: {Path(result['out']) / 'table.md'}")


@command(Move, LineOptions, *SCENES, ViewOptions, Port, show=_show_trials)
def trial(
    protocol: Annotated[str, Option(metavar="TASK|FILE.yaml")],
    *,
    trials: Annotated[int, count(1000)] = 10,
    verdict: Literal["person", "simulator"] = "person",
    out: Folder | None = None,
    resume: bool = False,
    logged: Annotated[bool, Option("--log")] = False,
    move: bool,
    view: bool,
    port: int,
    progress: ConsoleProgress,
    **given: Any,
) -> dict[str, Any]:
    """Guide a person through trials of a policy on an arm, and write a table of results.

    The trials follow the protocol of a TASK, or a protocol FILE. For each trial, the command tells the person where to
    put the objects and runs the policy. Then it asks whether the trial succeeded, and for a failed trial it asks for
    the cause. In a simulator the objects are placed automatically. Ctrl-C keeps the finished trials, and --resume
    continues after them. Several tasks may share one --out folder; the table lists all of its tasks.

    Args:
        trials: Number of placements to try.
        verdict: Who judges success; a person sees the simulator's verdict as a suggestion.
        out: Output folder with the table and a subfolder of records for each task.  [default:
            runs/trials-<date>-<time>]
        resume: Continue the trials in --out.
        logged: Write an MCAP log of each trial next to the records.
    """
    from gensim2_robot.devices import Keys
    from gensim2_robot.live import LivePage
    from gensim2_robot.trial.record import read_protocol
    from gensim2_robot.trial.run import Terminal
    from gensim2_robot.trial.run import trial as function

    asked, arguments = read_protocol(protocol), line_of(given)
    if not moves(arguments, move):
        wrong = "is required, because a trial moves the arm"
        raise InputError(wrong, field="--move", remedy="to test without moving the arm, use gensim2 robot dry-run")
    where = out or Path("runs") / time.strftime("trials-%Y%m%d-%H%M%S")
    with contextlib.ExitStack() as stack:
        watching = []
        if view:
            page = stack.enter_context(LivePage(arguments["robot"], f"{asked.task}, trials", port=port))
            progress.message(f"{page.url} shows the line")
            watching.append(page)
        keys = stack.enter_context(Keys())
        person = None if verdict == "simulator" else Terminal(keys, progress)
        found = function(
            asked,
            trials=trials,
            out=where,
            resume=resume,
            logged=logged,
            verdict=verdict,
            person=person,
            keys=keys,
            watching=watching,
            progress=progress,
            **arguments,
        )
    return {**found, "out": str(where)}


def _show(result: dict[str, Any]) -> None:
    line(f"{result['state']}: {result['reason']}")
    success = "" if result["success"] is None else f", {result['success']:.2f} held"
    passed = result["limits_passed"]
    exceeded = "no command exceeded a limit" if passed == 0 else f"{passed} commands exceeded a limit"
    line(f"{result['episodes']} {'episode' if result['episodes'] == 1 else 'episodes'}{success}; {exceeded}")
    if result["state"] == "idle" and result["episodes"] == 0 and result["episode_limit_s"] is not None:
        clock = "simulated time" if result["scheduling"] == "simulated" else "real time"
        line(
            f"no episode was finished in {result['seconds']:.0f} s of {clock}: at speed {result['speed']:g} an episode "
            f"may take up to {result['episode_limit_s']:.0f} s; give more --minutes or a higher --speed"
        )
    heads = ("ms", "median", "99th percentile", "worst")
    names = {
        "periods_ms": "period",
        "overrun_ms": "overrun",
        "picture_age_ms": "age of the pictures in the point cloud",
        "clouds_ms": "computing the point cloud",
        "acting_ms": "computing the action",
    }
    table(
        heads, [(said, *(number(result[name][key]) for key in ("p50", "p99", "worst"))) for name, said in names.items()]
    )
    if result["scheduling"] == "simulated":
        line("computing times are in real time; the other rows are in simulated time")
    for refusal in result["refusals"]:
        line(f"refused: {refusal}")
    for halt in result["halts"]:
        line(f"{halt['state']} within {number(halt['detected_to_stopped_ms'])} ms: {halt['reason']}")
    if result["log"] is not None:
        log = str(result["log"])
        line(f"log: {log}")
        line(f"next: {shlex.join(['gensim2', 'robot', 'export', log, '--out', f'{log}-film'])} makes a film of the log")
        replay = shlex.join(["gensim2", "robot", "replay", log])
        line(f"next: {replay} checks that the logged pictures give the same point clouds and actions again")


def _show_replay(result: dict[str, Any]) -> None:
    line(
        f"{plural(result['questions'], 'question')}, {plural(result['clouds'], 'cloud')}, "
        f"{plural(len(result['different']), 'different array')}"
    )
    for name in result["different"][:20]:
        line(name)
    if result["missing"]:
        line(f"pictures are missing for {plural(result['missing'], 'question')}")
    for name in result["unclosed"]:
        line(f"{name} has no end: its run was killed, and what it holds was compared")


def _show_check(result: dict[str, Any]) -> None:
    table(
        ("check", "", "found"),
        [(each["name"], "ok" if each["fine"] else "NO", each["found"]) for each in result["checks"]],
    )


def _run(progress: Progress, given: dict[str, Any], **beside: Any) -> dict[str, Any] | Ending:
    from gensim2_robot.devices import Keys
    from gensim2_robot.live import LivePage
    from gensim2_robot.log import prune_runs
    from gensim2_robot.run import run as function

    shown, port = given.pop("view"), given.pop("port")
    logged, out, arguments = given.pop("logged"), given.pop("out"), line_of(given)
    folder = None
    if logged:
        folder = out or Path("runs") / time.strftime("robot-%Y%m%d-%H%M%S")
        if out is None:
            prune_runs(folder.parent)
    with contextlib.ExitStack() as stack:
        watching = []
        if shown:
            page = stack.enter_context(LivePage(arguments["robot"], arguments["task"], port=port))
            progress.message(f"{page.url} shows the line")
            watching.append(page)
        keys = stack.enter_context(Keys())
        result = function(**arguments, **beside, log=folder, keys=keys, watching=watching, progress=progress)
    if result["interrupted"]:
        number = signal.Signals[result["interrupted"][0]]
        return Ending(result, KeyboardInterrupt() if number is signal.SIGINT else Stopped(number))
    return result if result["state"] == "idle" else Ending(result)


@command(Move, Minutes, LogOptions, LineOptions, *SCENES, ViewOptions, Port, show=_show)
def run(
    task: str,
    *,
    faults: Annotated[tuple[str, ...], Option("--fault", "NAME@SECONDS")] = (),
    move: bool,
    progress: Progress,
    **given: Any,
) -> dict[str, Any] | Ending:
    """Run episodes on an arm until a time limit, and report the results.

    In each episode a policy or the planner does TASK. A simulated arm repeats episodes until the time limit. A real arm
    runs only one episode and moves only with --move; without --move the run is a dry run. During the run a watchdog can
    hold or stop the arm. The watchdog is software and not safety-rated. After a hold, a person at the terminal presses
    r to resume the run, or any other key to stop the arm; without a terminal the run ends. Ctrl-C and SIGTERM stop the
    arm before the program ends. The command writes a JSON result unless the inputs are invalid. The exit code is 1 if
    the arm was held or stopped.

    Args:
        faults: Inject a fault into a simulated device from the given time (s) on; gensim2_robot.faults lists the names.
    """
    from gensim2_robot.faults import Fault

    failing = [Fault.parse(each) for each in faults]
    given["task"] = task
    line_of(dict(given))
    return _run(progress, given, dry=not moves(given, move), faults=failing)


@command(Minutes, LogOptions, LineOptions, *SCENES, ViewOptions, Port, name="dry-run", show=_show)
def dry_run(task: str, *, progress: Progress, **given: Any) -> dict[str, Any] | Ending:
    """Run a policy or the planner without sending commands to the arm.

    The command observes, computes actions, checks every limit and writes the log, as gensim2 robot run does.
    """
    return _run(progress, {**given, "task": task}, dry=True)


@command(LogOptions, LineOptions, *SCENES, Port)
def view(task: str, *, no_clouds: bool = False, **given: Any) -> None:
    """Show the data of the cameras and of the arm in the browser.

    The page shows point clouds, the robot, and the delays of images and of the control loop. Ctrl-C closes the page.
    The arm does not move. With --policy or --plan the page also shows the next actions.

    Args:
        no_clouds: Do not compute point clouds. Use this option if the cameras are not calibrated yet.
    """
    from gensim2_robot.config import CameraSource
    from gensim2_robot.live import PATIENT, looking
    from gensim2_robot.run import ENDLESS

    policy, plan = given["policy"], given["plan"]
    if no_clouds and (plan or policy is not None):
        raise click.UsageError("--no-clouds cannot be combined with --policy or --plan.")
    decides: Any = policy
    if policy is None and not plan:
        names = tuple(CameraSource.parse(given["cameras"]).devices) or None
        decides = looking(given["robot"], names, not no_clouds)
    # The page is for a person who watches, so the control loop runs in real time.
    real = given["real_time"] is not False
    given = {**given, "task": task, "policy": decides, "view": True, "minutes": 1e4, "real_time": real}
    with ConsoleProgress() as progress:
        found = _run(progress, given, dry=True, episodes=ENDLESS, rules=PATIENT)
    result = found.result if isinstance(found, Ending) else found
    _show(result)
    if isinstance(found, Ending):
        raise found.error


@command(show=_show_replay)
def replay(folder: Annotated[Path, Option(metavar="DIR")]) -> dict[str, Any] | Ending:
    """Recompute a log's point clouds and policy inputs, and compare them with the log.

    The command recomputes every cloud and input in the log DIR from the logged pictures and joints, and compares them
    byte by byte. The exit code is 1 if anything differs.
    """
    from gensim2_robot.log_reader import replay as function

    found = function(folder)
    result = {"schema_version": 1, **found.to_dict()}
    return Ending(result) if found.different else result


def _show_export(result: dict[str, Any]) -> None:
    line(f"{plural(result['frames'], 'frame')}, {result['seconds']:.1f} s")
    for name in result["files"]:
        line(name)


@command(show=_show_export)
def export(folder: Annotated[Path, Option(metavar="DIR")], *, out: Folder) -> dict[str, Any]:
    """Make a video, a picture and a Foxglove file from a log.

    The command writes four files. film.mp4 is a video with all cameras side by side. still.png is one picture of three
    moments of the first episode, at which the arm has made a sixth, a half and five sixths of its motion. foxglove.mcap
    contains images, the point cloud, the robot, the joints and the watchdog's state, and foxglove_layout.json is a
    layout to import in Foxglove.

    Args:
        out: Folder to write to.
    """
    from gensim2_robot.export import export as function

    return function(folder, out)


@command(show=_show_check)
def check(*, robot: str) -> dict[str, Any] | Ending:
    """Check the requirements of a run.

    The command checks packages, the clock, free disk space for the log, and the robot's start pose. The exit code is 1
    if a check fails.
    """
    from gensim2_robot.check import check as function

    found = function(robot, Path.cwd())
    result = {"schema_version": 1, "checks": found, "cores": usable_cores()}
    return result if all(each["fine"] for each in found) else Ending(result)


robot = click.Group(
    "robot",
    commands=[run, dry_run, view, trial, calibrate, fit_noise, replay, export, check],
    help="Drive an arm within limits, with a watchdog and a log. Read docs/guides/robot.md before driving a real arm.",
)

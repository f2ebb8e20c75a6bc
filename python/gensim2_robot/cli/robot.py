"""``gensim2 robot``."""

from __future__ import annotations

import contextlib
import signal
import time
from pathlib import Path
from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.main import FOUND_WRONG
from gensim2.cli.output import line, number, report, table
from gensim2.core.cores import usable_cores
from gensim2.core.errors import Stopped
from gensim2_robot.cli.robot_calibrate import calibrate, fit_noise
from gensim2_robot.cli.robot_options import LINE, MOVE, PAGE, RUN, all_of, line_of, moves
from gensim2_robot.cli.robot_trial import trial
from gensim2_robot.faults import FAULTS


@click.group("robot")
def robot() -> None:
    """Drive an arm through limits, a watch and a log. Read docs/guides/robot.md before you drive a real arm."""


robot.add_command(calibrate)
robot.add_command(fit_noise)
robot.add_command(trial)


@robot.command("run", cls=options.Command, short_help="Run episodes on an arm until the time is over.")
@click.argument("task")
@click.option(
    "--fault",
    "faults",
    multiple=True,
    metavar="NAME@SECONDS",
    help=f"Let a simulated device fail from then on: {', '.join(FAULTS)}.",
)
@all_of(MOVE, RUN, LINE, PAGE, (options.json_file,))
@click.pass_context
def run(ctx: click.Context, /, json_file: str | None, faults: tuple[str, ...], move: bool, **given: Any) -> None:
    """Let a policy or a plan do TASK again and again, and say what came of it.

    A real arm takes one episode, and without --move it is a dry run. A software stop, not safety-rated. Where a watch
    holds the arm, a person at the terminal resumes (r) or stops (any other key); without one the run ends there. Ctrl-C
    and SIGTERM stop the arm first. The JSON is written however it ends. Ends with 1 where the arm was held or stopped.
    """
    from gensim2_robot.faults import Fault

    failing = [Fault.parse(each) for each in faults]
    line_of(dict(given))
    _run(ctx, json_file, given, dry=not moves(given, move), faults=failing)


@robot.command("dry-run", cls=options.Command, short_help="The same, with nothing sent to the arm.")
@click.argument("task")
@all_of(RUN, LINE, PAGE, (options.json_file,))
@click.pass_context
def dry_run(ctx: click.Context, /, json_file: str | None, **given: Any) -> None:
    """Look, think, check every limit and write everything down, as gensim2 robot run does, and send nothing."""
    _run(ctx, json_file, given, dry=True)


@robot.command("view", cls=options.Command, short_help="See in the browser what the cameras and the arm say.")
@click.argument("task")
@click.option(
    "--no-clouds", is_flag=True, help="Pictures alone, into the log: of cameras that are to be calibrated by it."
)
@all_of(RUN[1:], LINE, PAGE[1:])
@click.pass_context
def view(ctx: click.Context, /, policy: str | None, plan: bool, no_clouds: bool, **given: Any) -> None:
    """Show clouds, robot and clocks in the browser until Ctrl-C, and move nothing.

    With --policy or --plan the page shows the actions that it would take next, too.
    """
    from gensim2_robot.config import CameraSource
    from gensim2_robot.live import PATIENT, looking
    from gensim2_robot.run import ENDLESS

    if no_clouds and (plan or policy is not None):
        raise click.UsageError("--no-clouds is without --policy and --plan.")
    decides: Any = policy
    if policy is None and not plan:
        names = tuple(CameraSource.parse(given["cameras"]).devices) or None
        decides = looking(given["robot"], names, not no_clouds)
    real = given["real_time"] is not False  # a person looks on
    given = {**given, "policy": decides, "plan": plan, "view": True, "minutes": 1e4, "real_time": real}
    _run(ctx, None, given, dry=True, episodes=ENDLESS, rules=PATIENT)


def _run(ctx: click.Context, json_file: str | None, given: dict[str, Any], **beside: Any) -> None:
    shown, port = given.pop("view"), given.pop("port")
    logged, out, arguments = given.pop("logged"), given.pop("out"), line_of(given)
    folder = None
    if logged:
        folder = out or Path("runs") / time.strftime("robot-%Y%m%d-%H%M%S")
    with report(json_file, _show) as (progress, give), contextlib.ExitStack() as stack:
        from gensim2_robot.keys import Keys
        from gensim2_robot.log import prune_runs
        from gensim2_robot.run import run as function

        if folder is not None and out is None:
            prune_runs(folder.parent)
        watching = []
        if shown:
            from gensim2_robot.live import LivePage

            page = stack.enter_context(LivePage(arguments["robot"], arguments["task"], port=port))
            progress.message(f"{page.url} shows the line")
            watching.append(page)
        keys = stack.enter_context(Keys())
        result = function(**arguments, **beside, log=folder, keys=keys, watching=watching, progress=progress)
        give(result)
    if result["interrupted"]:
        number = signal.Signals[result["interrupted"][0]]
        raise KeyboardInterrupt if number is signal.SIGINT else Stopped(number)
    if result["state"] != "idle":
        ctx.exit(FOUND_WRONG)


def _show(result: dict[str, Any]) -> None:
    line(f"{result['state']}: {result['reason']}")
    success = "" if result["success"] is None else f", {result['success']:.2f} held"
    passed = result["limits_passed"]
    exceeded = "no command exceeded a limit" if passed == 0 else f"{passed} commands exceeded a limit"
    line(f"{result['episodes']} episodes{success}; {exceeded}")
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
        [(said, *(number(result[name][key]) for key in ("p50", "p99", "worst"))) for name, said in names.items()],
    )
    for halt in result["halts"]:
        line(f"{halt['state']} within {number(halt['detected_to_stopped_ms'])} ms: {halt['reason']}")
    if result["log"] is not None:
        line(f"log: {result['log']}")


@robot.command("replay", cls=options.Command, short_help="Make a log's clouds and inputs anew, and compare.")
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
@options.json_file
@click.pass_context
def replay(ctx: click.Context, /, folder: Path, json_file: str | None) -> None:
    """Make every cloud and every input of the log in DIR anew from its pictures and joints, and compare byte for byte.

    Ends with 1 where anything differs.
    """
    with report(json_file, _show_replay) as (_, give):
        from gensim2_robot.replay import replay as function

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
    for name in result["unclosed"]:
        line(f"{name} has no end: its run was killed, and what it holds was compared")


@robot.command("check", cls=options.Command, short_help="Say whether everything is there to drive an arm.")
@options.robot
@options.json_file
@click.pass_context
def check(ctx: click.Context, /, json_file: str | None, **given: Any) -> None:
    """Look at what a run needs: packages, the clock, room for the log, the robot's start; ends with 1 without."""
    with report(json_file, _show_check) as (_, give):
        from gensim2_robot.check import check as function

        found = function(given["robot"], Path.cwd())
        give({"schema_version": 1, "checks": found, "cores": usable_cores()})
    if not all(each["fine"] for each in found):
        ctx.exit(FOUND_WRONG)


def _show_check(result: dict[str, Any]) -> None:
    table(
        ("check", "", "found"),
        [(each["name"], "ok" if each["fine"] else "NO", each["found"]) for each in result["checks"]],
    )

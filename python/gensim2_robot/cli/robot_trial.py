"""``gensim2 robot trial``."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path
from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.output import line, report, table
from gensim2.core.errors import InputError
from gensim2_robot.cli.robot_options import LINE, MOVE, PAGE, all_of, line_of, moves


@click.command("trial", cls=options.Command, short_help="Lead a person through trials, and write the table.")
@click.argument("protocol", metavar="TASK|FILE.yaml")
@click.option("--trials", type=options.count(1000), default=10, show_default=True, help="Placements to try.")
@click.option(
    "--verdict",
    type=click.Choice(("person", "simulator")),
    default="person",
    show_default=True,
    help="Whose counts; what a simulator says is offered to the person.",
)
@options.out("Folder of the table, with a folder of records a task.  [default: runs/trials-<date>-<time>]")
@options.resume
@click.option("--log", "logged", is_flag=True, help="Write everything down, as MCAP files beside the records.")
@all_of(MOVE, LINE, PAGE, (options.json_file,))
def trial(protocol: str, json_file: str | None, move: bool, verdict: str, out: Path | None, **given: Any) -> None:
    """Carry out trials by the protocol of a TASK, or by a FILE of your own.

    Says where things are to be put, lets the policy act, asks whether it did it, and if not, why. What is finished is
    kept when Ctrl-C ends it, and --resume goes on. A simulator puts things there itself. Several tasks may share --out:
    the table holds all of them.
    """
    from gensim2_robot.trial.protocol import read_protocol

    asked = read_protocol(protocol)
    shown, port, arguments = given.pop("view"), given.pop("port"), line_of(given)
    if given["resume"] and out is None:
        raise InputError("needs the folder to go on with", field="--resume", remedy="give --out")
    if not moves(arguments, move):
        raise InputError("a trial moves the arm", field="--move", remedy="gensim2 robot dry-run looks without moving")
    where = out or Path("runs") / time.strftime("trials-%Y%m%d-%H%M%S")
    with report(json_file, _show) as (progress, give), contextlib.ExitStack() as stack:
        from gensim2_robot.keys import Keys
        from gensim2_robot.trial.person import Terminal
        from gensim2_robot.trial.run import trial as function

        watching = []
        if shown:
            from gensim2_robot.live import LivePage

            page = stack.enter_context(LivePage(arguments["robot"], f"{asked.task}, trials", port=port))
            progress.message(f"{page.url} shows the line")
            watching.append(page)
        keys = stack.enter_context(Keys())
        person = None if verdict == "simulator" else Terminal(keys, progress)
        found = function(
            asked,
            out=where,
            verdict=verdict,  # type: ignore[arg-type]  # a choice of the option
            person=person,
            keys=keys,
            watching=watching,
            progress=progress,
            **arguments,
        )
        give({**found, "out": str(where)})


def _show(result: dict[str, Any]) -> None:
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

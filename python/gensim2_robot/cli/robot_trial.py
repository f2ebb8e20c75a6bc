"""``gensim2 robot trial``."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path
from typing import Annotated, Any, Literal

from gensim2.cli.options import command
from gensim2.cli.output import line, table
from gensim2.cli.typed import Folder, Option, count
from gensim2.core.errors import InputError
from gensim2.core.progress import ConsoleProgress
from gensim2_robot.cli.robot_options import SCENES, Line, Move, Port, View, line_of, moves


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


@command(Move, Line, *SCENES, View, Port, show=_show)
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
    """Lead a person through trials, and write the table.

    Carries out trials by the protocol of a TASK, or by your own FILE. Says where to put each object, lets the policy
    act, and asks whether it succeeded, and if not, why. Finished trials are kept after Ctrl-C, and --resume continues.
    A simulator places the objects itself. Several tasks may share --out: the table holds all of them.

    Args:
        trials: Number of placements to try.
        verdict: Source of the verdict; the simulator's verdict is suggested to the person.
        out: Folder of the table, with a folder of records for each task.  [default: runs/trials-<date>-<time>]
        resume: Continue the trials in --out.
        logged: Record everything as MCAP files beside the records.
    """
    from gensim2_robot.keys import Keys
    from gensim2_robot.live import LivePage
    from gensim2_robot.trial.person import Terminal
    from gensim2_robot.trial.protocol import read_protocol
    from gensim2_robot.trial.run import trial as function

    asked, arguments = read_protocol(protocol), line_of(given)
    if not moves(arguments, move):
        raise InputError("a trial moves the arm", field="--move", remedy="gensim2 robot dry-run looks without moving")
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

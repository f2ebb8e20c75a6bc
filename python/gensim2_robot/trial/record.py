"""Folder of trials: one line of JSON each, written when it is over, and the table that follows from them."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from gensim2.core.errors import InputError, WriteError
from gensim2.core.files import write_atomic, write_json
from gensim2.core.foreign.tree import MAX_RECORD, read_regular, why
from gensim2.core.record_files import parse_record, read_record
from gensim2.core.resumable import ResumableFolder, RunSettings
from gensim2.rollout.tally import interval
from gensim2.scenes.config import SceneRecord

ASKED, LINES, TABLE, RESULT = "asked.json", "trials.jsonl", "table.md", "table.json"
REMEDY = "choose another --out"


class Asked(RunSettings):
    """``asked.json``: what the trials of one folder have in common.

    Attributes:
        task: its name.
        policy: what decides, in words.
        seed: of the placements.
        protocol: all of it.
        line: what the line follows from.
        scene: what the scenes follow from.
    """

    schema_version: Literal[1] = 1
    task: str
    policy: str
    seed: int
    protocol: dict[str, Any]
    line: dict[str, Any]
    scene: SceneRecord

    @property
    def arm(self) -> str:
        """The arm of the line."""
        return str(self.line.get("arm", ""))


class Trial(BaseModel):
    """One trial.

    Attributes:
        number: counts from 0; placements follow from it and from the seed.
        placements: by object, m, rad and a share.
        success: the verdict.
        cause: of a failure.
        by: whose verdict it is.
        goal: whether the simulator says that the goal held; None: there is none.
        state, reason: of the watch at the end.
        seconds: that the episode took.
        at: when it ended, with its time zone.
    """

    model_config = ConfigDict(extra="forbid")

    number: Annotated[int, Field(ge=0)]
    placements: dict[str, dict[str, Any]]
    success: bool
    cause: str | None
    by: Literal["person", "simulator", "watch"]
    goal: bool | None
    state: str
    reason: str
    seconds: Annotated[float, Field(allow_inf_nan=False)]
    at: str


_TRIAL = TypeAdapter(Trial)


class TrialFolder(ResumableFolder[Asked]):
    """Trials of one task with one policy.

    Args:
        folder: of them.
        asked: what they have in common.
        resume: go on with what the folder holds.

    Attributes:
        trials: that are over, by number.

    Raises:
        InputError: the folder holds other trials, or ``resume`` is missing.
    """

    def __init__(self, folder: Path, asked: Asked, resume: bool) -> None:
        super().__init__(folder, ASKED, asked, holds="trials", resume=resume, alone=False)
        try:
            self.trials = {each.number: each for each in read_trials(folder)}
        except BaseException:
            self.release()
            raise

    def add(self, trial: Trial) -> None:
        """Keep a trial, whatever comes after; a last line that was cut off is overwritten.

        Raises:
            WriteError: it cannot be written.
        """
        path = self.path / LINES
        try:
            with path.open("ab+") as stream:
                stream.truncate(len(_whole_lines(read_regular(path, MAX_RECORD))))
                stream.write(trial.model_dump_json().encode() + b"\n")
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            raise WriteError(f"cannot write: {error.strerror or error}", file=path) from error
        self.trials[trial.number] = trial


def read_trials(folder: Path) -> list[Trial]:
    """Trials of a folder; a last line that was cut off is left out.

    Raises:
        InputError: the file cannot be read, or a line before the last is damaged or repeats a trial.
    """
    path = folder / LINES
    try:
        data = read_regular(path, MAX_RECORD)
    except FileNotFoundError:
        return []
    except OSError as error:
        raise InputError(why(error), file=path, remedy=REMEDY) from error
    found: dict[int, Trial] = {}
    for number, row in enumerate(_whole_lines(data).splitlines(), 1):
        trial = parse_record(row, _TRIAL, path, REMEDY, f"line {number}")
        if trial.number in found:
            raise InputError(f"repeats trial {trial.number}", file=path, field=f"line {number}", remedy=REMEDY)
        found[trial.number] = trial
    return list(found.values())


def _whole_lines(data: bytes) -> bytes:
    """Return all but a last line that was cut off while it was written."""
    return data[: data.rfind(b"\n") + 1]


def row_of(asked: Asked, trials: Sequence[Trial]) -> dict[str, Any]:
    """Figures of one task, with Wilson's interval."""
    successes = sum(each.success for each in trials)
    return {
        "task": asked.task,
        "policy": asked.policy,
        "arm": asked.arm,
        "trials": len(trials),
        "successes": successes,
        "rate": successes / len(trials) if trials else None,
        "interval": list(interval(successes, len(trials))),
        "causes": dict(Counter(each.cause or "not said" for each in trials if not each.success).most_common()),
        "judged_by": dict(Counter(each.by for each in trials).most_common()),
    }


def write_table(out: Path) -> dict[str, Any]:
    """Write the table of all trials in the folders of ``out``, and the same as JSON; return it as plain data.

    Raises:
        InputError: a folder is damaged.
        WriteError: they cannot be written.
    """
    rows = []
    for path in sorted(out.glob(f"*/{ASKED}")):
        trials = sorted(read_trials(path.parent), key=lambda each: each.number)
        row = row_of(read_record(path, Asked, REMEDY), trials)
        rows.append({**row, "folder": path.parent.name, "records": [each.model_dump(mode="json") for each in trials]})
    rates = [row["rate"] for row in rows if row["rate"] is not None]
    result = {"schema_version": 1, "rows": rows, "mean": sum(rates) / len(rates) if rates else None}
    write_json(out / RESULT, result)
    write_atomic(out / TABLE, table_of(result))
    return result


def table_of(result: dict[str, Any]) -> str:
    """The table as Markdown."""
    lines = [
        "| task | policy | arm | trials | succeeded | 95 % (Wilson) | causes of failures |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for row in result["rows"]:
        causes = ", ".join(f"{count} {cause}" for cause, count in row["causes"].items())
        rate = "" if row["rate"] is None else f"{row['rate']:.2f}"
        low, high = row["interval"]
        cells = (row["task"], row["policy"], row["arm"], row["trials"], rate, f"{low:.2f} to {high:.2f}", causes)
        lines.append("| " + " | ".join(str(cell).replace("|", "/").replace("\n", " ") for cell in cells) + " |")
    return "\n".join(lines) + "\n"

"""Read protocols of trials, and record the results of trials."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator

from gensim2.core.errors import InputError, near
from gensim2.core.files import not_written, write_atomic, write_json
from gensim2.core.foreign.limits import MAX_RECORD
from gensim2.core.foreign.tree import read_input, read_regular
from gensim2.core.record_files import parse_record, read_record
from gensim2.core.resumable import ResumableFolder, RunSettings
from gensim2.core.seeding import rng
from gensim2.core.validation import input_error
from gensim2.core.yaml_files import read_yaml
from gensim2.rollout.tally import interval
from gensim2.scenes.config import SceneRecord
from gensim2.scenes.randomize import draw_object, openness_at_reset
from gensim2.tasks.presets import preset
from gensim2.tasks.spec import Name, Offset, Randomization, TaskSpec

FOLDER = Path(__file__).parents[1] / "protocols"
"""Folder of the protocols that come with the package."""
Text = Annotated[str, Field(min_length=1, max_length=400)]
Metres = Annotated[float, Field(ge=-3, le=3)]
"""Type of a coordinate (m) in the robot's base frame that an arm can reach."""
Shares = tuple[Annotated[float, Field(ge=0, le=1)], Annotated[float, Field(ge=0, le=1)]]


class PlacementRange(BaseModel):
    """Ranges from which the placement of one object is drawn.

    Attributes:
        at: centre of the ranges: distance (m) in front of the robot's base, and distance (m) to its left.
        x, y: ranges (m) of the offset to the front and to the left. A single number r stands for -r to r.
        yaw: maximum rotation about the vertical axis, degrees. An object is rotated towards the robot: objects to the
            left of the centre and objects to the right are rotated in opposite directions.
        openness: range of the openness (0 to 1) of the object's joint; None without a joint.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    at: tuple[Metres, Metres]
    x: Offset = (-0.1, 0.1)
    y: Offset = (-0.1, 0.1)
    yaw: Annotated[float, Field(ge=-180, le=180)] = 30.0
    openness: Shares | None = None

    @model_validator(mode="after")
    def _opens_in_order(self) -> PlacementRange:
        if self.openness is not None and self.openness[0] > self.openness[1]:
            raise ValueError("the first number of the range 'openness' must not exceed the second")
        return self


@dataclass(frozen=True)
class Placed:
    """Placement of one object in one trial.

    Attributes:
        x: distance of the object in front of the robot's base, m.
        y: distance of the object to the left of the robot's base, m.
        offset: offset from the centre of the ranges: to the front (m), to the left (m), and rotation about the vertical
            (rad).
        openness: openness (0 to 1) of the object's joint; None without a joint.
    """

    x: float
    y: float
    offset: tuple[float, float, float]
    openness: float | None

    def told(self, name: str) -> str:
        """Describe the placement in a line of text for the person who lays out the scene."""
        side = "left" if self.y >= 0 else "right"
        degrees = math.degrees(self.offset[2])
        turn = "anticlockwise" if degrees >= 0 else "clockwise"
        opened = "" if self.openness is None else f", opened to {100 * self.openness:.0f} % of its range"
        return (
            f"{name}: middle {100 * self.x:.0f} cm ahead of the robot's base and {100 * abs(self.y):.0f} cm to the "
            f"{side}, turned {abs(degrees):.0f} degrees {turn} as seen from above{opened}"
        )


class TrialProtocol(BaseModel):
    """Content of a protocol file, for example ``protocols/TASK.yaml``.

    Attributes:
        objects: description of each object, for the person who lays out the scene.
        sentence: instruction for the policy.
        verdict: question to the person who judges the trial; the answer "yes" means that the trial succeeded.
        causes: causes of failure from which the person can choose.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    schema_version: Literal[1] = 1
    task: Annotated[str, Field(min_length=1, max_length=100)]
    objects: dict[Name, Text]
    placements: dict[Name, PlacementRange]
    sentence: Text
    verdict: Text
    causes: Annotated[tuple[Text, ...], Field(min_length=1, max_length=20)]

    @model_validator(mode="after")
    def _places_every_object(self) -> TrialProtocol:
        if set(self.objects) != set(self.placements):
            raise ValueError("objects and placements must have the same names")
        return self

    def require(self, task: TaskSpec) -> None:
        """Check that a task has the same objects as the protocol.

        Raises:
            InputError: the task has other objects.
        """
        if set(self.objects) != set(task.objects):
            said = f"the task has {', '.join(task.objects)}"
            raise InputError(said, file=f"protocol of {self.task}", field="objects")

    def place(self, seed: int, number: int) -> dict[str, Placed]:
        """Draw the random placements of one trial."""
        generator, found = rng(seed, f"{self.task}/trial placements", number), {}
        for name, given in self.placements.items():
            low, high = given.openness or (0.0, 0.0)
            ranges = Randomization(
                x=given.x,
                y=given.y,
                yaw=math.radians(given.yaw),
                openness_mean=0.5 * (low + high),
                openness_spread=0.5 * (high - low),
            )
            drawn = draw_object(generator, ranges, preset("paper"), ("",))
            openness = None if given.openness is None else openness_at_reset(ranges, drawn, 0.0)
            at = given.at[0] + drawn.x, given.at[1] + drawn.y
            found[name] = Placed(*at, (drawn.x, drawn.y, drawn.yaw), openness)
        return found


def reset_options(placed: Mapping[str, Placed]) -> dict[str, Any]:
    """Return the reset options that make a simulator place the objects as given."""
    return {
        "offset": {name: list(each.offset) for name, each in placed.items()},
        "openness": {name: each.openness for name, each in placed.items() if each.openness is not None},
    }


def protocol_names() -> list[str]:
    """Return the names of the protocols that come with the package."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def read_protocol(word: str) -> TrialProtocol:
    """Read the protocol of a task, given by the task's name or by a file.

    Raises:
        InputError: the protocol does not exist or is invalid; the message names the file and the field.
    """
    own = word.endswith((".yaml", ".yml", ".json"))
    if not own and word not in protocol_names():
        remedy = f"{near(word, protocol_names())}, or give a file"
        raise InputError(f"there is no protocol {word!r}", field="protocol", remedy=remedy)
    path = Path(word) if own else FOLDER / f"{word}.yaml"
    try:
        return TrialProtocol.model_validate(read_yaml(path))
    except ValidationError as error:
        raise input_error(error, file=path) from error


ASKED, LINES, TABLE, RESULT = "asked.json", "trials.jsonl", "table.md", "table.json"
REMEDY = "choose another --out"


class TrialSettings(RunSettings):
    """Content of ``asked.json``: settings that all trials in a folder share.

    Attributes:
        policy: description of the policy.
        seed: seed of the placements.
        protocol: protocol of the trials.
        line: settings of the control loop.
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
        return str(self.line.get("arm", ""))


class Trial(BaseModel):
    """Record of one trial.

    Attributes:
        number: number of the trial, from 0. Number and seed determine the placements.
        placements: placement of each object by name.
        success: whether the trial succeeded.
        cause: cause of the failure; None after a success.
        by: origin of the verdict: a person, the simulator, or the watchdog if it ended the trial.
        goal: whether the goal was reached in the simulator; None without a simulator.
        state, reason: state of the watchdog at the end.
        seconds: duration of the episode, s.
        at: time of the end, with time zone.
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


class TrialFolder(ResumableFolder[TrialSettings]):
    """Folder with the trials of one task with one policy.

    Args:
        folder: path of the folder.
        asked: settings of the trials.
        resume: whether to continue the trials in the folder.

    Attributes:
        trials: finished trials by number.

    Raises:
        InputError: the folder has trials with other settings, or has trials and ``resume`` is false.
    """

    def __init__(self, folder: Path, asked: TrialSettings, resume: bool) -> None:
        super().__init__(folder, ASKED, asked, holds="trials", resume=resume, alone=False)
        try:
            self.trials = {each.number: each for each in read_trials(folder)}
        except BaseException:
            self.release()
            raise

    def add(self, trial: Trial) -> None:
        """Append a trial to the file and flush it to disk; an incomplete last line is overwritten.

        Raises:
            WriteError: the file cannot be written.
        """
        path = self.path / LINES
        try:
            with path.open("ab+") as stream:
                stream.truncate(len(_whole_lines(read_regular(path, MAX_RECORD))))
                stream.write(trial.model_dump_json().encode() + b"\n")
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            raise not_written(error, path) from error
        self.trials[trial.number] = trial


def read_trials(folder: Path) -> list[Trial]:
    """Read the trials in a folder; an incomplete last line is ignored.

    Raises:
        InputError: the file cannot be read, or an earlier line is damaged or repeats a trial.
    """
    path = folder / LINES
    data = read_input(path, MAX_RECORD, REMEDY, b"")
    found: dict[int, Trial] = {}
    for number, row in enumerate(_whole_lines(data).splitlines(), 1):
        trial = parse_record(row, _TRIAL, path, REMEDY, f"line {number}")
        if trial.number in found:
            raise InputError(f"repeats trial {trial.number}", file=path, field=f"line {number}", remedy=REMEDY)
        found[trial.number] = trial
    return list(found.values())


def _whole_lines(data: bytes) -> bytes:
    """Return the data without an incomplete last line."""
    return data[: data.rfind(b"\n") + 1]


def row_of(asked: TrialSettings, trials: Sequence[Trial]) -> dict[str, Any]:
    """Return the results of one task as a table row, with the Wilson interval of the success rate."""
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
    """Write the table of all trials in subfolders of ``out``, as text and as JSON. Return it as plain data.

    Raises:
        InputError: a folder is damaged.
        WriteError: the files cannot be written.
    """
    rows = []
    for path in sorted(out.glob(f"*/{ASKED}")):
        trials = sorted(read_trials(path.parent), key=lambda each: each.number)
        row = row_of(read_record(path, TrialSettings, REMEDY), trials)
        rows.append({**row, "folder": path.parent.name, "records": [each.model_dump(mode="json") for each in trials]})
    rates = [row["rate"] for row in rows if row["rate"] is not None]
    result = {"schema_version": 1, "rows": rows, "mean": sum(rates) / len(rates) if rates else None}
    write_json(out / RESULT, result)
    write_atomic(out / TABLE, table_of(result))
    return result


def table_of(result: dict[str, Any]) -> str:
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

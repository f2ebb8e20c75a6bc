"""Read the measured success rates of the library's tasks. All tables of success rates in the documentation are made
from these measurements.

Only ``benchmarks/figures.py`` writes the data file ``figures.json.xz``, from the JSON output of ``gensim2 benchmark``.
Each row of the data file holds the results of one task in one benchmark.
"""

from __future__ import annotations

import lzma
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from gensim2.core.errors import InputError
from gensim2.core.foreign.limits import MAX_RECORD
from gensim2.core.renamed import current
from gensim2.core.validation import input_error

FIGURES = "figures.json.xz"

Count = Annotated[int, Field(ge=0)]


class _Value(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


def _current_word(word: object) -> object:
    return current(word, {"ours": "default"}, "physics") if isinstance(word, str) else word


OWNERS = {"default": "default physics", "original": "the original's physics"}
"""Phrases for the physics presets in tables; mixed settings appear under their own name."""


class Condition(_Value):
    """Conditions under which the success rate of a task was measured.

    Attributes:
        objects: ``"generated"`` for the built-in objects, or ``"real"`` for objects from a folder.
        physics: ``"default"``, ``"original"``, or a preset with changed settings such as ``"default+solver=original"``.
            Earlier files write ``"ours"`` for ``"default"``.
        engine: simulation engine.
        instances: selection of objects, with the same values as the option ``--instances``.
        randomization: preset for the ranges from which initial scenes are sampled: ``"paper"``, ``"paper-half"`` or
            ``"wide"``.
        attempts: maximum number of attempts in an episode, each from the same initial scene.
        open_loop: whether all motions of an episode were planned at its start.
        disturbance: disturbance during each episode: ``"push"``, ``"drop"`` or None.
        one_plan: whether each step was planned only once, with the first of its strategies.
    """

    objects: Literal["generated", "real"]
    physics: Annotated[str, Field(min_length=1, max_length=500), BeforeValidator(_current_word)]
    robot: str
    instances: str
    randomization: str
    attempts: Annotated[int, Field(ge=1)]
    open_loop: bool
    disturbance: str | None
    one_plan: bool = False
    engine: Literal["sapien", "mujoco"] = "sapien"

    @property
    def is_plain(self) -> bool:
        """Whether the conditions are the paper's.

        The paper's conditions are its ranges, all instances, a closed loop, one attempt, and no disturbance.
        """
        return not self.deviations

    @property
    def in_words(self) -> str:
        """The conditions in words: physics, objects, and every deviation from the paper's protocol."""
        whose = [OWNERS[self.physics]] if self.physics in OWNERS else []
        return ", ".join([*whose, f"{self.objects} objects", *self.deviations])

    @property
    def deviations(self) -> list[str]:
        """Deviations from the paper's protocol, in words."""
        found = {
            f"physics {self.physics}": self.physics not in OWNERS,
            f"engine {self.engine}": self.engine != "sapien",
            f"robot {self.robot}": self.robot != "panda",
            f"instances {self.instances}": self.instances != "all",
            f"ranges {self.randomization}": self.randomization != "paper",
            f"{self.attempts} attempts": self.attempts > 1,
            "open loop": self.open_loop,
            "one plan a step": self.one_plan,
            f"disturbed: {self.disturbance}": self.disturbance is not None,
        }
        return [words for words, deviates in found.items() if deviates]


class Verdicts(_Value):
    """Number of episodes, and number of episodes that pass each verdict."""

    episodes: Count
    paper: Count
    held: Count
    strict: Count


class Source(_Value):
    """Origin of a row.

    Attributes:
        commit: commit of the source code, with the suffix ``-modified`` if the code had local changes.
        date: day on which the measurement finished, ``YYYY-MM-DD``.
        command: command that produced the row.
    """

    commit: str
    date: str
    command: str


class Figure(_Value):
    """Results of one task under one set of conditions. Results are counts of episodes, except ``deviation``.

    The verdicts ``paper``, ``held`` and ``strict`` are three definitions of success, from lenient to strict
    (docs/reference/episodes.md).

    Attributes:
        condition: conditions of the measurement.
        seed: seed of the scenes.
        runs: number of runs, all with the same number of episodes.
        episodes: number of episodes in all runs.
        paper, held, strict: number of successful episodes according to each verdict.
        deviation: standard deviation of the ``paper`` success rate between runs.
        partial: number of episodes in which only part of a motion was executed.
        causes: number of episodes that are failures according to ``held``, by cause, most frequent cause first.
        strict_misses: number of episodes that are failures according to ``strict``, by the condition that was not met,
            most frequent condition first.
        objects: number of different objects by class.
        instances: verdicts by object. The key is ``class/id``; keys of several objects are joined with ``" + "``. The
            mapping is empty in rows that were written before this field existed.
        source: commit, date and command of the measurement; None in rows that were written before this field existed.
    """

    task: str
    condition: Condition
    seed: Count
    runs: Annotated[int, Field(ge=1)]
    episodes: Annotated[int, Field(ge=1)]
    paper: Count
    held: Count
    strict: Count
    deviation: Annotated[float, Field(ge=0, le=1)]
    partial: Count
    causes: dict[str, Count]
    strict_misses: dict[str, Count]
    objects: dict[str, Count]
    instances: dict[str, Verdicts] = {}
    source: Source | None = None

    @model_validator(mode="after")
    def _counts_go_together(self) -> Self:
        if not self.strict <= self.held <= self.episodes or self.paper > self.episodes:
            raise ValueError("'strict' must not exceed 'held', and neither 'held' nor 'paper' may exceed 'episodes'")
        if self.held + sum(self.causes.values()) != self.episodes:
            raise ValueError("'held' and the counts in 'causes' do not sum to 'episodes'")
        for name in ("episodes", "paper", "held", "strict") if self.instances else ():
            if sum(getattr(each, name) for each in self.instances.values()) != getattr(self, name):
                raise ValueError(f"the values of '{name}' in 'instances' do not sum to the '{name}' of the row")
        return self


class Figures(_Value):
    """Content of ``figures.json.xz``: at most one row for each task and condition."""

    schema_version: Literal[1]
    rows: tuple[Figure, ...]

    @model_validator(mode="after")
    def _one_row_each(self) -> Self:
        keys = [(row.task, row.condition) for row in self.rows]
        if len(set(keys)) < len(keys):
            raise ValueError("two rows have the same task and condition")
        return self


@cache
def figures() -> Figures:
    """Return the measured results that are shipped with the package."""
    return parse_figures((files("gensim2.tasks") / FIGURES).read_bytes(), FIGURES)


def figures_of(task: str) -> tuple[Figure, ...]:
    """Return all rows of a task, with the rows under the paper's protocol first.

    Empty rows mean that it was not measured.
    """
    return tuple(row for row in figures().rows if row.task == task)


def parse_figures(data: bytes, file: Path | str) -> Figures:
    """Return the measured results in the content of a file. A file with the suffix ``.xz`` is compressed.

    Raises:
        InputError: the content is invalid; the message names the field.
    """
    remedy = "write it anew with benchmarks/figures.py"
    try:
        text = lzma.LZMADecompressor().decompress(data, MAX_RECORD) if str(file).endswith(".xz") else data
        return Figures.model_validate_json(text)
    except lzma.LZMAError as error:
        raise InputError(f"is damaged: {error}", file=file, remedy=remedy) from error
    except ValidationError as error:
        raise input_error(error, file=file, remedy=remedy) from error

"""Success rates of the library's tasks: measured figures as data, from which every table of the project is made.

``figures.json`` is written from the JSON files of ``gensim2 benchmark`` by ``benchmarks/figures.py`` alone: a row
is what the episodes of one file say of one task.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from gensim2.core.foreign.tree import MAX_RECORD, read_input
from gensim2.core.renamed import current
from gensim2.core.validation import input_error

FIGURES = "figures.json"

Count = Annotated[int, Field(ge=0)]


class _Value(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


def _current_word(word: object) -> object:
    return current(word, {"ours": "default"}, "physics") if isinstance(word, str) else word


OWNERS = {"default": "default physics", "original": "the original's physics"}
"""Presets in words; other mixtures are called as they are spelled."""


class Condition(_Value):
    """Conditions of a measurement.

    Attributes:
        objects: ``"generated"`` ones, or ``"real"`` ones from a folder.
        physics: ``"default"`` (``"ours"`` in earlier files), ``"original"``, or the word for a mixture.
        engine: that simulated it.
        robot: its name.
        instances: which were drawn from, as in ``--instances``.
        randomization: ranges of the scene: ``"paper"``, ``"paper-half"`` or ``"wide"``.
        attempts: tries of an episode from the same start.
        open_loop: everything was planned at the start.
        disturbance: ``"push"``, ``"drop"`` or None.
        one_plan: each step was planned once, by its first strategy.
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
        """Whether it is the paper's protocol: its ranges, all instances, closed loop, one attempt, undisturbed."""
        return not self.deviations

    @property
    def in_words(self) -> str:
        """Physics, objects and deviations from the paper's protocol, in words."""
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
    """Numbers of episodes, and of those that fulfil each verdict."""

    episodes: Count
    paper: Count
    held: Count
    strict: Count


class Source(_Value):
    """Source of a row.

    Attributes:
        commit: of the sources; ``-modified`` behind it where they were no longer those.
        date: on which the table was finished, ``YYYY-MM-DD``.
        command: that made it.
    """

    commit: str
    date: str
    command: str


class Figure(_Value):
    """One task under one condition; counts are numbers of episodes.

    Attributes:
        task: its name.
        condition: what it was measured under.
        seed: of the scenes.
        runs: repetitions, of equally many episodes.
        episodes: of all runs.
        paper, held, strict: how many fulfil each verdict.
        deviation: between the runs, of the share that fulfils ``paper``.
        partial: in how many a part of a motion was executed.
        causes: why those do not count as held that do not, most frequent first.
        strict_misses: what those lack that do not count as strict, most frequent first.
        objects: number of different ones by class.
        instances: verdicts by the objects that episodes were run with, ``class/id`` and between several ``" + "``; none
            of rows that are older than this field.
        source: where it comes from; None of rows that are older than this field.
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
            raise ValueError("more episodes count than there are, or strict ones that do not hold")
        if self.held + sum(self.causes.values()) != self.episodes:
            raise ValueError("held and causes are not all episodes")
        for name in ("episodes", "paper", "held", "strict") if self.instances else ():
            if sum(getattr(each, name) for each in self.instances.values()) != getattr(self, name):
                raise ValueError(f"{name} of the instances are not those of the row")
        return self


class Figures(_Value):
    """The file: at most one row for each task and condition."""

    schema_version: Literal[1]
    rows: tuple[Figure, ...]

    @model_validator(mode="after")
    def _one_row_each(self) -> Self:
        keys = [(row.task, row.condition) for row in self.rows]
        if len(set(keys)) < len(keys):
            raise ValueError("a task has two rows of the same condition")
        return self

    def with_rows(self, rows: Iterable[Figure]) -> Figures:
        """Return these and others: a new row takes the place of one of the same task and condition."""
        found = {(row.task, row.condition): row for row in (*self.rows, *rows)}
        return Figures(schema_version=1, rows=tuple(sorted(found.values(), key=_order)))


def _order(row: Figure) -> tuple[str, bool, tuple[str, ...]]:
    """By task; the paper's protocol first."""
    return row.task, not row.condition.is_plain, tuple(str(value) for _, value in row.condition)


@cache
def figures() -> Figures:
    """Return the figures that travel with the package."""
    return _parsed((files("gensim2.tasks") / FIGURES).read_bytes(), FIGURES)


def read_figures(path: Path) -> Figures:
    """Return the figures of a file.

    Raises:
        InputError: it cannot be read, or holds none; names the field.
    """
    return _parsed(read_input(path, MAX_RECORD), path)


def figures_of(task: str) -> tuple[Figure, ...]:
    """Return all rows of a task, those of the paper's protocol first; none where it was not measured."""
    return tuple(row for row in figures().rows if row.task == task)


def _parsed(data: bytes, file: Path | str) -> Figures:
    try:
        return Figures.model_validate_json(data)
    except ValidationError as error:
        raise input_error(error, file=file, remedy="write it anew with benchmarks/figures.py") from error

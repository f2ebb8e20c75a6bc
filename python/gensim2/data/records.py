"""Records of runs, designs and verifications: plain values that become JSON."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from gensim2.core.record_files import SCHEMA_VERSION
from gensim2.core.resumable import RunSettings, differing
from gensim2.rollout.config import RolloutOptions, nested_options
from gensim2.rollout.record import Episode
from gensim2.rollout.tally import Tally
from gensim2.scenes.config import SCENE_FIELDS, SceneOptions, SceneRecord

RUN_SCHEMA_VERSION: Literal[4] = 4
"""Of ``run.json``, and with it of what a run can go on with."""

Instances = Literal["new", "test", "all"]


class Record(BaseModel):
    """A file of the run folder; nothing is converted and nothing is let pass."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


FIXED_ARGUMENTS = (
    "command",
    "seed",
    *SCENE_FIELDS,
    *(field.name for field in fields(RolloutOptions)),
    "designer",
    "target_task",
    "stored_tasks",
    "wish",
    "scenes",
    "runs",
    "episodes",
    "verify",
    "from_empty",
)
"""Arguments that a resumed run must share with the run it resumes; the others change its length or its speed."""


class Effort(Record):
    """Cost of the design and verification of a task, in the call in which that was finished: CPU of all processes,
    time."""

    cpu_s: Annotated[float, Field(ge=0)]
    wall_s: Annotated[float, Field(ge=0)]


class RunRecord(RunSettings):
    """``run.json``."""

    model_config = Record.model_config

    schema_version: Literal[4]
    arguments: SceneRecord
    identity: dict[str, str]
    command_line: list[str]
    started: str
    finished: str | None
    versions: dict[str, str]
    platform: str
    assets: dict[str, str]
    licenses: dict[str, str]
    result: dict[str, Any] | None
    resumed: Annotated[int, Field(ge=0)]
    effort: dict[str, Effort] = Field(default_factory=dict)

    def differences(self, now: Self) -> Iterator[tuple[str, str]]:
        """Yield the differences in what the results follow from; a run may get longer."""
        was, given = ({name: each.arguments.get(name) for name in FIXED_ARGUMENTS} for each in (self, now))
        yield from differing("arguments", was, given)
        yield from differing("identity", self.identity, now.identity)
        yield from differing("versions", self.versions, now.versions)

    def resumed_by(self, now: Self) -> Self:
        """Return this record with the present arguments, without an outcome."""
        update = {"arguments": now.arguments, "finished": None, "result": None, "resumed": self.resumed + 1}
        return self.model_copy(update=update)


class VerificationRecord(Record):
    """``verification.json``."""

    schema_version: Literal[2]
    threshold: Annotated[float, Field(ge=0, le=1)]
    kept: bool
    instances: Instances
    paper: Annotated[int, Field(ge=0)]
    held: Annotated[int, Field(ge=0)]
    strict: Annotated[int, Field(ge=0)]
    partial: Annotated[int, Field(ge=0)]
    causes: dict[str, int]
    strict_misses: dict[str, int]
    objects: dict[str, int]
    episodes: Annotated[list[Episode], Field(min_length=1)]

    @model_validator(mode="after")
    def _counts_are_those_of_the_episodes(self) -> Self:
        told = self.verification
        counts = self.model_dump(exclude={"schema_version", "threshold", "kept", "instances", "episodes"})
        if self.kept != told.kept or counts != told.tally.to_dict():
            raise ValueError("the counts are not those of the episodes")
        return self

    @property
    def verification(self) -> Verification:
        """As a value."""
        return Verification(tuple(self.episodes), self.threshold, self.instances)


class EnvironmentSummary(BaseModel):
    """Part of a report about the environment of demonstrations."""

    env_id: str


class RecordingSummary(BaseModel):
    """Part of a report about ``trajectory.json``."""

    env_info: EnvironmentSummary
    episodes: list[Any]


class ArgumentsSummary(BaseModel):
    """Part of a report about the arguments of a run; scenes and rollouts under names of their own."""

    command: str
    seed: int
    scene: SceneOptions
    rollout: RolloutOptions


class RejectionSummary(BaseModel):
    """Why a task was not designed."""

    name: str
    reason: str


class ResultSummary(BaseModel):
    """Part of a report about the outcome of a run."""

    rejected: list[RejectionSummary] = []
    notes: list[str] = []


class RunSummary(BaseModel):
    """Part of a report about the fields of ``run.json`` that not every run has."""

    arguments: Annotated[ArgumentsSummary, BeforeValidator(nested_options)]
    result: ResultSummary | None


@dataclass(frozen=True)
class Verification:
    """A task and its strategies put to the test on fresh seeds.

    Attributes:
        episodes: in the order of the seeds.
        threshold: share of them that must hold.
        instances: which objects they drew from: ``"new"`` (numbers beyond the listed ones of a generated class) and
            ``"test"`` were seen by no search; ``"all"`` where a class is too small to keep some apart.
    """

    episodes: tuple[Episode, ...]
    threshold: float
    instances: Instances

    @cached_property
    def tally(self) -> Tally:
        """Counts over the episodes."""
        return Tally.of(self.episodes)

    @property
    def rate(self) -> float:
        """Share of episodes that held."""
        return self.tally.held / len(self.episodes) if self.episodes else 0.0

    @property
    def kept(self) -> bool:
        """Whether the rate reaches the threshold."""
        return self.rate >= self.threshold

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "schema_version": 2,
            "threshold": self.threshold,
            "kept": self.kept,
            "instances": self.instances,
            **self.tally.to_dict(),
            "episodes": [episode.to_dict() for episode in self.episodes],
        }


@dataclass(frozen=True)
class DesignEffort:
    """Cost of a search.

    Attributes:
        candidates: that were planned.
        episodes: of physics.
        cpu_s: CPU of all processes in this call; next to nothing where it was done in an earlier one.
    """

    candidates: int
    episodes: int
    cpu_s: float = 0.0

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {"candidates": self.candidates, "episodes": self.episodes, "cpu_s": round(self.cpu_s, 3)}


@dataclass(frozen=True)
class TaskOutcome:
    """One line of the result: a task that was verified, kept or not.

    Attributes:
        name: of the task.
        asset_class: of its objects, with commas between them.
        goal: types of the criteria that must hold in the end.
        kept: whether enough episodes of the verification held.
        verification: over its episodes.
        fresh: over the episodes of the verification and of the collection.
        demos: demonstrations that were collected.
        cpu_s: CPU of all processes for these episodes, in this call.
        effort: of the search; None where there was none.
    """

    name: str
    asset_class: str
    goal: str
    kept: bool
    verification: Tally
    fresh: Tally
    demos: int
    cpu_s: float
    effort: DesignEffort | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return it with the field names of the command's JSON."""
        return {
            "name": self.name,
            "class": self.asset_class,
            "goal": self.goal,
            "kept": self.kept,
            "verified": {
                "episodes": self.verification.episodes,
                "successes": self.verification.held,
                **self.verification.verdicts(),
                "objects": self.verification.objects,
            },
            "demos": self.demos,
            "episodes_run": self.fresh.episodes,
            **self.fresh.verdicts(),
            "cpu_s": round(self.cpu_s, 3),
            "design": None if self.effort is None else self.effort.to_dict(),
        }


@dataclass(frozen=True)
class PipelineResult:
    """Result of ``run_pipeline``.

    Attributes:
        run_dir: the run folder.
        tasks: every task that was designed, in order.
        rejected: proposals for which no candidate got past the screening, with the reason.
        notes: what a reader should know (fewer tasks than asked for, instances left out, ...).
    """

    run_dir: str
    tasks: tuple[TaskOutcome, ...]
    rejected: tuple[dict[str, str], ...]
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "schema_version": SCHEMA_VERSION,
            "run_dir": self.run_dir,
            "tasks": [task.to_dict() for task in self.tasks],
            "rejected": list(self.rejected),
            "notes": list(self.notes),
        }


def merge_causes(causes: Sequence[str | None]) -> dict[str, int]:
    """Count the causes that are not None."""
    return dict(Counter(cause for cause in causes if cause is not None))

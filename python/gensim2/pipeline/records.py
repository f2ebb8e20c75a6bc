"""What the pipeline knows after an attempt, a design, a verification: plain values that become JSON."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, model_validator

from gensim2.designers.base import CandidateResult

SCHEMA_VERSION = 1

RUN_SCHEMA_VERSION: Literal[2] = 2
"""Of ``run.json``, and with it of what a run can go on with."""


@dataclass(frozen=True)
class Attempt:
    """One episode in physics.

    Attributes:
        seed: of the environment's reset.
        instance: id of the object.
        content_hash: of everything that the object was made from.
        success: the task's criteria hold at the end AND they do not with a still arm.
        still_success: whether they hold with a still arm; None where that did not need to be run.
        openness_start, openness_end: of the object's joint; None where it is no number any more.
        steps: control steps executed.
        cause: None for a success, otherwise one short phrase.
        plan_status: status of the plan.
        plan_reason: its sentence for a person.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid", strict=True)

    seed: int
    instance: str
    content_hash: str
    success: bool
    still_success: bool | None
    openness_start: FiniteFloat | None
    openness_end: FiniteFloat | None
    steps: Annotated[int, Field(ge=0)]
    cause: str | None
    plan_status: str
    plan_reason: str

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return asdict(self)


@dataclass(frozen=True, kw_only=True)
class LoggedAttempt(Attempt):
    """An attempt as a log keeps it.

    Attributes:
        index: in the order of the seeds.
        episode_digest: of the episode's file; None where none was kept.
    """

    index: Annotated[int, Field(ge=0)]
    episode_digest: str | None = None

    @staticmethod
    def of(attempt: Attempt, index: int, episode_digest: str | None = None) -> LoggedAttempt:
        """Return ``attempt`` with its place."""
        return LoggedAttempt(**attempt.to_dict(), index=index, episode_digest=episode_digest)


class Record(BaseModel):
    """A file of the run folder; nothing is converted and nothing is let pass."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class RunRecord(Record):
    """``run.json``."""

    schema_version: Literal[2]
    arguments: dict[str, Any]
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


class VerificationRecord(Record):
    """``verification.json``."""

    schema_version: Literal[1]
    threshold: Annotated[float, Field(ge=0, le=1)]
    kept: bool
    successes: Annotated[int, Field(ge=0)]
    causes: dict[str, int]
    episodes: list[Attempt]

    @model_validator(mode="after")
    def _counts_are_those_of_the_episodes(self) -> Self:
        told = Verification(tuple(self.episodes), self.threshold)
        if (self.successes, self.kept, self.causes) != (told.successes, told.kept, told.causes()):
            raise ValueError("the counts are not those of the episodes")
        return self


class EnvironmentSummary(BaseModel):
    """What a report says of the environment of demonstrations."""

    env_id: str


class RecordingSummary(BaseModel):
    """What a report says of ``trajectory.json``."""

    env_info: EnvironmentSummary
    episodes: list[Any]


class ArgumentsSummary(BaseModel):
    """What a report says of what a run was asked for."""

    command: str
    seed: int
    assets: str


class RejectionSummary(BaseModel):
    """Why a task was not designed."""

    name: str
    reason: str


class ResultSummary(BaseModel):
    """What a report says of how a run ended."""

    rejected: list[RejectionSummary] = []
    notes: list[str] = []


class RunSummary(BaseModel):
    """What a report says of ``run.json`` beyond what every run has."""

    arguments: ArgumentsSummary
    result: ResultSummary | None


class StageRecord(Record):
    """One stage of a candidate in ``design.json``."""

    name: Literal["plan", "physics"]
    episodes: Annotated[int, Field(ge=0)]
    successes: float
    causes: dict[str, int]


class CandidateRecord(Record):
    """One candidate in ``design.json``."""

    index: Annotated[int, Field(ge=0)]
    label: str
    config: dict[str, Any]
    provenance: dict[str, Any]
    stages: list[StageRecord]
    cause: str | None


class DesignRecord(Record):
    """``design.json``."""

    schema_version: Literal[1]
    candidates: list[CandidateRecord]
    chosen: Literal[0] | None
    config: dict[str, Any] | None
    notes: list[str]

    @model_validator(mode="after")
    def _says_why_nothing_was_chosen(self) -> Self:
        if (self.config is None) != (self.chosen is None):
            raise ValueError("chosen and config do not go together")
        if self.config is None and not self.notes:
            raise ValueError("nothing was chosen, and notes do not say why")
        return self


@dataclass(frozen=True)
class Verification:
    """A task and config put to the test on fresh seeds."""

    attempts: tuple[Attempt, ...]
    threshold: float

    @property
    def successes(self) -> int:
        """Number of attempts that held."""
        return sum(attempt.success for attempt in self.attempts)

    @property
    def rate(self) -> float:
        """Share of attempts that held."""
        return self.successes / len(self.attempts) if self.attempts else 0.0

    @property
    def kept(self) -> bool:
        """Whether the rate reaches the threshold."""
        return self.rate >= self.threshold

    def causes(self) -> dict[str, int]:
        """Count what went wrong, most frequent first."""
        return dict(Counter(a.cause for a in self.attempts if a.cause is not None).most_common())

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "schema_version": SCHEMA_VERSION,
            "threshold": self.threshold,
            "kept": self.kept,
            "successes": self.successes,
            "causes": self.causes(),
            "episodes": [attempt.to_dict() for attempt in self.attempts],
        }


@dataclass(frozen=True)
class Design:
    """The outcome of a search: every candidate with its stages, best first, and the config that won, if any."""

    results: tuple[CandidateResult, ...]
    chosen: dict[str, Any] | None
    notes: tuple[str, ...] = field(default=())

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "schema_version": SCHEMA_VERSION,
            "candidates": [_candidate(index, result) for index, result in enumerate(self.results)],
            "chosen": 0 if self.chosen is not None else None,
            "config": self.chosen,
            "notes": list(self.notes),
        }


def _candidate(index: int, result: CandidateResult) -> dict[str, Any]:
    causes: Counter[str] = Counter()
    for stage in result.stages:
        causes.update(stage.causes)
    return {
        "index": index,
        "label": result.candidate.label,
        "config": result.candidate.config,
        "provenance": result.candidate.provenance,
        "stages": [
            {"name": s.name, "episodes": s.trials, "successes": s.score * s.trials, "causes": s.causes}
            for s in result.stages
        ],
        "cause": causes.most_common(1)[0][0] if causes else None,
    }


@dataclass(frozen=True)
class TaskOutcome:
    """One line of the result: a task that was designed, kept or not."""

    name: str
    asset_class: str
    goal: str
    kept: bool
    episodes: int
    successes: int
    demos: int

    def to_dict(self) -> dict[str, Any]:
        """Return it with the field names of the command's JSON."""
        return {
            "name": self.name,
            "class": self.asset_class,
            "goal": self.goal,
            "kept": self.kept,
            "verified": {"episodes": self.episodes, "successes": self.successes},
            "demos": self.demos,
        }


@dataclass(frozen=True)
class PipelineResult:
    """What ``run_pipeline`` returns.

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

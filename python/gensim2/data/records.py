"""Define the records of runs, designs and verifications; all their values can be stored as JSON."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, BeforeValidator, Field, model_validator

from gensim2.core.record_files import SCHEMA_VERSION, Record
from gensim2.core.resumable import RunSettings, differing
from gensim2.rollout.checker_result import CheckerResult, WorldCount
from gensim2.rollout.config import RolloutOptions, nested_options
from gensim2.rollout.record import Episode
from gensim2.rollout.tally import Tally, engines_record
from gensim2.scenes.config import SCENE_FIELDS, SceneOptions, SceneRecord
from gensim2.scenes.physics import Engine

RUN_SCHEMA_VERSION: Literal[4] = 4
"""Version of ``run.json``; a run can be resumed by the same version only."""

Instances = Literal["new", "test", "all"]


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
"""Arguments that must be equal when a run is resumed; all other arguments only affect its length or speed."""


class Effort(Record):
    """CPU time and wall time spent on designing and verifying a task since the last start of the run."""

    cpu_s: Annotated[float, Field(ge=0)]
    wall_s: Annotated[float, Field(ge=0)]


class RunRecord(RunSettings):
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
        """Yield the differences between this record and ``now`` that change results.

        The number of tasks or episodes may grow.
        """
        was, given = ({name: each.arguments.get(name) for name in FIXED_ARGUMENTS} for each in (self, now))
        yield from differing("arguments", was, given)
        for name in sorted(self.identity.keys() | now.identity.keys()):
            if self.identity.get(name) != now.identity.get(name):
                yield f"identity.{name}", f"the {name} changed after the run began"
        yield from differing("versions", self.versions, now.versions)

    def resumed_by(self, now: Self) -> Self:
        """Return the record for the run that resumes this run.

        The new record has the arguments of ``now``, no end time and no result.
        """
        update = {"arguments": now.arguments, "finished": None, "result": None, "resumed": self.resumed + 1}
        return self.model_copy(update=update)


class SecondEngineRecord(Record):
    """Record of the same scenes in the second physics engine, stored in ``verification.json``."""

    engine: Engine
    held: Annotated[int, Field(ge=0)]
    episodes: Annotated[list[Episode], Field(min_length=1)]


class VerificationRecord(Record):
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
    second: SecondEngineRecord | None = None

    @model_validator(mode="after")
    def _counts_are_those_of_the_episodes(self) -> Self:
        told = self.verification
        counts = self.model_dump(exclude={"schema_version", "threshold", "kept", "instances", "episodes", "second"})
        wrong = self.second is not None and told.second is not None and self.second.held != told.second.tally.held
        if self.kept != told.kept or counts != told.tally.to_dict() or wrong:
            raise ValueError("the counts do not match the episodes in the field 'episodes'")
        return self

    @property
    def verification(self) -> Verification:
        second = None if self.second is None else SecondEngine(self.second.engine, tuple(self.second.episodes))
        return Verification(tuple(self.episodes), self.threshold, self.instances, second)


class CheckerRecord(Record):
    """Content of ``checker.json``."""

    schema_version: Literal[1]
    scenes: Annotated[int, Field(ge=1)]
    worlds: Annotated[int, Field(ge=0)]
    fooled: Annotated[int, Field(ge=0)]
    error: Annotated[float, Field(ge=0, le=1)]
    recognized: Annotated[int, Field(ge=0)]
    built: Annotated[int, Field(ge=0)]
    counts: list[WorldCount]

    @model_validator(mode="after")
    def _figures_are_those_of_the_counts(self) -> Self:
        if self.model_dump() != {"schema_version": 1, **self.result.to_dict()}:
            raise ValueError("the totals do not match the entries of the field 'counts'")
        return self

    @property
    def result(self) -> CheckerResult:
        return CheckerResult(self.scenes, tuple(self.counts))


class EnvironmentSummary(BaseModel):
    env_id: str


class RecordingSummary(BaseModel):
    env_info: EnvironmentSummary
    episodes: list[Any]


class ArgumentsSummary(BaseModel):
    """Arguments of a run that the report shows: command, seed, scene options and rollout options."""

    command: str
    seed: int
    scene: SceneOptions
    rollout: RolloutOptions


class RejectionSummary(BaseModel):
    name: str
    reason: str


class ResultSummary(BaseModel):
    rejected: list[RejectionSummary] = []
    notes: list[str] = []


class RunSummary(BaseModel):
    """Optional fields of ``run.json`` that the report shows."""

    arguments: Annotated[ArgumentsSummary, BeforeValidator(nested_options)]
    result: ResultSummary | None


@dataclass(frozen=True)
class SecondEngine:
    """Episodes of a verification, repeated on the same scenes in the other physics engine.

    Attributes:
        engine: physics engine.
        episodes: episodes in the order of the seeds.
    """

    engine: Engine
    episodes: tuple[Episode, ...]

    @cached_property
    def tally(self) -> Tally:
        """Counts of the episodes by verdict and cause."""
        return Tally.of(self.episodes)

    @property
    def rate(self) -> float:
        """Success rate: fraction of episodes that pass `held`."""
        return self.tally.held / self.tally.episodes


@dataclass(frozen=True)
class Verification:
    """Verification of a task and its strategies in new scenes.

    Attributes:
        episodes: episodes in the order of the seeds.
        threshold: smallest success rate for keeping the task.
        instances: set of the objects. ``"new"``: generated objects that the library does not list; ``"test"``: the test
            split; ``"all"``: all objects, if a class has too few for the others. The search used no object of the sets
            ``"new"`` and ``"test"``.
        second: episodes in the same scenes in the other physics engine; None if only one engine is used.
    """

    episodes: tuple[Episode, ...]
    threshold: float
    instances: Instances
    second: SecondEngine | None = None

    @cached_property
    def tally(self) -> Tally:
        return Tally.of(self.episodes)

    @property
    def rate(self) -> float:
        return self.tally.held / len(self.episodes) if self.episodes else 0.0

    @property
    def kept(self) -> bool:
        """Whether the success rate reaches the threshold.

        If the task was verified in two engines, the rate must reach the threshold in both.
        """
        return self.rate >= self.threshold and (self.second is None or self.second.rate >= self.threshold)

    def to_dict(self) -> dict[str, Any]:
        second = None
        if self.second is not None:
            episodes = [episode.to_dict() for episode in self.second.episodes]
            second = {"engine": self.second.engine, "held": self.second.tally.held, "episodes": episodes}
        return {
            "schema_version": 2,
            "threshold": self.threshold,
            "kept": self.kept,
            "instances": self.instances,
            **self.tally.to_dict(),
            "episodes": [episode.to_dict() for episode in self.episodes],
            **({} if second is None else {"second": second}),
        }


@dataclass(frozen=True)
class DesignEffort:
    """Number of candidates and episodes of a strategy search, and its CPU time.

    Attributes:
        candidates: number of planned candidates.
        episodes: number of simulated episodes.
        cpu_s: CPU time of all processes in this call, s; about 0 if an earlier call searched.
    """

    candidates: int
    episodes: int
    cpu_s: float = 0.0

    def to_dict(self) -> dict[str, Any]:
        return {"candidates": self.candidates, "episodes": self.episodes, "cpu_s": round(self.cpu_s, 3)}


@dataclass(frozen=True)
class TaskOutcome:
    """Result of one verified task, kept or rejected.

    Attributes:
        asset_class: classes of its objects, separated by commas.
        goal: types of the success criteria.
        kept: whether the success rate reaches the threshold.
        verification: numbers of successful and failed episodes in the verification.
        fresh: the same numbers for verification and demonstrations together.
        demos: number of collected demonstrations.
        cpu_s: CPU time of all processes for verification and demonstrations in this call, s.
        effort: cost of the search; None without a search.
        checker: how often the criteria held in scenes that were changed so that the task is not done. None in earlier
            records.
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
    checker: CheckerResult | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the result as JSON data, with the field names that the command prints."""
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
            **engines_record(self.fresh.engines, self.fresh.disagreed),
            "episodes_run": self.fresh.episodes,
            **self.fresh.verdicts(),
            "cpu_s": round(self.cpu_s, 3),
            "design": None if self.effort is None else self.effort.to_dict(),
            "checker": None if self.checker is None else self.checker.summary(),
        }


@dataclass(frozen=True)
class PipelineResult:
    """Result of ``run_pipeline``.

    Attributes:
        run_dir: run folder.
        tasks: designed tasks in the order in which they were finished.
        rejected: proposed tasks that were not verified, with the reason.
        notes: remarks for the user, for example about unusable objects.
    """

    run_dir: str
    tasks: tuple[TaskOutcome, ...]
    rejected: tuple[dict[str, str], ...]
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        return {
            "schema_version": SCHEMA_VERSION,
            "run_dir": self.run_dir,
            "tasks": [task.to_dict() for task in self.tasks],
            "rejected": list(self.rejected),
            "notes": list(self.notes),
        }


def merge_causes(causes: Sequence[str | None]) -> dict[str, int]:
    """Return the number of failed episodes by cause; None stands for a success and is not counted."""
    return dict(Counter(cause for cause in causes if cause is not None))

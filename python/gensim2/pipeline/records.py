"""What the pipeline knows after an attempt, a design, a verification: plain values that become JSON."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from gensim2.designers.base import CandidateResult

SCHEMA_VERSION = 1


@dataclass(frozen=True)
class Attempt:
    """One episode in physics.

    Attributes:
        seed: of the environment's reset.
        instance: id of the object.
        success: the task's criteria hold at the end AND they do not with a still arm.
        still_success: whether they hold with a still arm; None where that did not need to be run.
        openness_start, openness_end: of the object's joint.
        steps: control steps executed.
        cause: None for a success, otherwise one short phrase.
        plan_status: status of the plan.
        plan_reason: its sentence for a person.
    """

    seed: int
    instance: str
    success: bool
    still_success: bool | None
    openness_start: float
    openness_end: float
    steps: int
    cause: str | None
    plan_status: str
    plan_reason: str

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return asdict(self)


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

    @staticmethod
    def from_dict(value: dict[str, Any]) -> Verification:
        """Inverse of ``to_dict``."""
        return Verification(
            attempts=tuple(Attempt(**episode) for episode in value["episodes"]), threshold=value["threshold"]
        )


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

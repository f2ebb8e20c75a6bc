"""Define the result of a strategy search, in memory and in ``design.json``."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from gensim2.core.files import write_json
from gensim2.core.record_files import Record, read_record
from gensim2.design.base import CandidateResult
from gensim2.tasks.strategies import StepStrategies


class DiagnosisRecord(Record):
    """Record of a kind of failure of a candidate, in ``design.json``."""

    step: str | None
    cause: str
    words: str
    count: Annotated[int, Field(ge=1)]


class StageRecord(Record):
    """Record of a candidate's result in one search stage, in ``design.json``."""

    name: Literal["plan", "physics"]
    episodes: Annotated[int, Field(ge=0)]
    successes: float
    causes: dict[str, int]
    strict: float = 0.0
    diagnoses: list[DiagnosisRecord] = Field(default_factory=list)


class CandidateRecord(Record):
    """Record of a candidate and its results, in ``design.json``."""

    index: Annotated[int, Field(ge=0)]
    label: str
    steps: dict[str, dict[str, dict[str, Any]]]
    provenance: dict[str, Any]
    stages: list[StageRecord]
    cause: str | None


class DesignRecord(Record):
    """Content of ``design.json``."""

    schema_version: Literal[3]
    candidates: list[CandidateRecord]
    chosen: Literal[0] | None
    steps: dict[str, dict[str, dict[str, Any]]] | None
    notes: list[str]

    @model_validator(mode="after")
    def _says_why_nothing_was_chosen(self) -> Self:
        if (self.steps is None) != (self.chosen is None):
            raise ValueError("the fields 'chosen' and 'steps' must either both be null or both have a value")
        if self.steps is None and not self.notes:
            raise ValueError("no candidate was chosen, so the field 'notes' must give the reason, but it is empty")
        return self


@dataclass(frozen=True)
class Design:
    """Result of a search: candidates with their results, best first, and the chosen strategies, if any."""

    results: tuple[CandidateResult, ...]
    chosen: StepStrategies | None
    notes: tuple[str, ...] = field(default=())

    def to_dict(self) -> dict[str, Any]:
        """Return a dictionary for JSON."""
        return {
            "schema_version": 3,
            "candidates": [_candidate(index, result) for index, result in enumerate(self.results)],
            "chosen": 0 if self.chosen is not None else None,
            "steps": self.chosen,
            "notes": list(self.notes),
        }


def _candidate(index: int, result: CandidateResult) -> dict[str, Any]:
    causes: Counter[str] = Counter()
    for stage in result.stages:
        causes.update(stage.causes)
    return {
        "index": index,
        "label": result.candidate.label,
        "steps": result.candidate.steps,
        "provenance": result.candidate.provenance,
        "stages": [
            {
                "name": s.name,
                "episodes": s.trials,
                "successes": s.score * s.trials,
                "causes": s.causes,
                "strict": s.strict * s.trials,
                "diagnoses": [each.to_dict() for each in s.diagnoses],
            }
            for s in result.stages
        ],
        "cause": causes.most_common(1)[0][0] if causes else None,
    }


def write_design(folder: Path, design: Design) -> None:
    """Write ``design.json`` into a task's folder."""
    write_json(folder / "design.json", design.to_dict())


def read_design(folder: Path) -> DesignRecord | None:
    """Return the content of ``design.json`` in a task's folder; None if the file does not exist.

    Raises:
        InputError: the file is damaged.
    """
    path = folder / "design.json"
    return read_record(path, DesignRecord, "delete the file and resume") if path.exists() else None

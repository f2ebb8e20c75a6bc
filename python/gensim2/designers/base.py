"""The interface of a designer, whether a search or a language model stands behind it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from gensim2.objects.types import Instance
from gensim2.tasks.spec import TaskSpec

Goal = Literal["articulated_open", "articulated_closed"]

DESIGNED = "designed"
"""Name of the strategy that a designer writes for a step."""

Strategies = dict[str, dict[str, Any]]
"""Strategies by name, as plain data: what stands in ``strategies/<name>.yaml``."""


@dataclass(frozen=True)
class Affordance:
    """What a designer is told of an object class: no simulator, no geometry beyond what it needs.

    Attributes:
        asset_class: class name.
        joint_type: ``"revolute"`` or ``"prismatic"``.
        default_openness: mean openness at the start of an episode.
        keypoints: name to description, those that every seen instance has on its moving link.
        lever_arms: name to mean distance in metres from the joint axis (revolute), or zero (prismatic).
    """

    asset_class: str
    joint_type: Literal["revolute", "prismatic"]
    default_openness: float
    keypoints: dict[str, str]
    lever_arms: dict[str, float]

    @staticmethod
    def of(instances: Sequence[Instance]) -> Affordance:
        """Return what ``instances`` of one class have in common."""
        first = instances[0]
        shared = [
            name
            for name in first.keypoints
            if all(
                name in other.keypoints and other.keypoints[name].link == other.joint.child_link for other in instances
            )
        ]
        return Affordance(
            asset_class=first.asset_class,
            joint_type=first.joint.type,
            default_openness=first.default_openness,
            keypoints={name: first.keypoints[name].description for name in shared},
            lever_arms={
                name: sum(_lever_arm(instance, name) for instance in instances) / len(instances) for name in shared
            },
        )


def _lever_arm(instance: Instance, keypoint: str) -> float:
    return instance.lever_arm(keypoint) if instance.joint.type == "revolute" else 0.0


@dataclass(frozen=True)
class Candidate:
    """One way to do a task.

    Attributes:
        label: a phrase for the report.
        steps: for each step of the task its strategies.
        provenance: how it came about (search parameters, or prompt and answer).
    """

    label: str
    steps: dict[str, Strategies]
    provenance: dict[str, Any]

    @property
    def strategies(self) -> Strategies:
        """Those of all steps by name, as a task's folder holds them."""
        return {name: data for strategies in self.steps.values() for name, data in strategies.items()}


@dataclass(frozen=True)
class StageResult:
    """How a candidate fared in one stage of the search.

    Attributes:
        name: of the stage.
        trials: scenes planned, or episodes.
        score: share of them that were planned whole, or held.
        causes: counts of what went wrong.
        strict: share of the episodes that meet the strict verdict as well; 0 where none was run.
    """

    name: Literal["plan", "physics"]
    trials: int
    score: float
    causes: dict[str, int]
    strict: float = 0.0


@dataclass(frozen=True)
class CandidateResult:
    """A candidate and all that is known of it."""

    candidate: Candidate
    stages: tuple[StageResult, ...]

    @property
    def physics_score(self) -> float:
        """Share of physics episodes that held over all stages, shrunk towards zero where few were run."""
        return self.held / (self.episodes + 1)

    @property
    def strict_score(self) -> float:
        """The same of episodes that meet the strict verdict."""
        return self.strict / (self.episodes + 1)

    @property
    def episodes(self) -> int:
        """Physics episodes over all stages."""
        return sum(stage.trials for stage in self._physics)

    @property
    def held(self) -> float:
        """How many of them held."""
        return sum(stage.score * stage.trials for stage in self._physics)

    @property
    def strict(self) -> float:
        """How many of them meet the strict verdict."""
        return sum(stage.strict * stage.trials for stage in self._physics)

    @property
    def _physics(self) -> list[StageResult]:
        return [stage for stage in self.stages if stage.name == "physics"]

    @property
    def plan_score(self) -> float:
        """Share of scenes in which a whole plan was found."""
        plans = [stage for stage in self.stages if stage.name == "plan"]
        return plans[-1].score if plans else 0.0


class Designer(Protocol):
    """Proposes tasks, writes candidates, and learns from how they fared."""

    name: str

    def propose(self, affordances: Iterable[Affordance], known: Sequence[TaskSpec], seed: int) -> Iterable[TaskSpec]:
        """Yield new tasks, best first; none repeats the class and goal of a known one."""
        ...

    def candidates(self, task: TaskSpec, affordance: Affordance, seed: int) -> list[Candidate]:
        """Return the first round of candidates for a task whose steps leave their strategies to the designer.

        Raises:
            InputError: the designer cannot design such a task.
        """
        ...

    def refine(
        self,
        task: TaskSpec,
        affordance: Affordance,
        results: Sequence[CandidateResult],
        seed: int,
        round: int,
    ) -> list[Candidate]:
        """Return new candidates given how earlier ones fared, best first; an empty list ends the search."""
        ...

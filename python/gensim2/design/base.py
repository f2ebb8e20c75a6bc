"""Define the interface of designers, which propose tasks and strategies by search or with a language model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Protocol

from gensim2.core.errors import GenSim2Error
from gensim2.design.affordance import Affordance
from gensim2.design.diagnosis import Diagnosis
from gensim2.tasks.spec import TaskSpec
from gensim2.tasks.strategies import Strategies, with_strategies

Goal = Literal["articulated_open", "articulated_closed"]


class Declined(GenSim2Error):
    """A designer has no candidate strategies for a task; the task is rejected and the run continues."""


@dataclass(frozen=True)
class RobotSummary:
    """Summary of the robot for designers.

    Attributes:
        robot: name of the robot.
        base: x and y of the robot's base in the world, m. The top of the table is z = 0, and x points away from the
            robot.
        reach: maximum horizontal distance from the base, m, at which a hand that points down touches the table.
        stroke: maximum distance between the finger pads, m.
        tool_keypoints: description of each keypoint of the hand, by name.
    """

    robot: str
    base: tuple[float, float]
    reach: float
    stroke: float
    tool_keypoints: dict[str, str]


@dataclass(frozen=True)
class Known:
    """A task that already exists.

    Attributes:
        task: definition of the task.
        strategies: strategies of the task's steps, by name.
        held, episodes: number of successful episodes and of all episodes in the latest verification; zero without a
            verification.
    """

    task: TaskSpec
    strategies: Strategies
    held: int = 0
    episodes: int = 0


@dataclass(frozen=True)
class Brief:
    """Information for a designer about the robot, the objects and the existing tasks.

    Attributes:
        settings: summary of the robot.
        classes: affordance (summary) of each articulated or rigid object class, by class name.
        known: existing tasks. Proposals must not repeat them, and long tasks may use them. The run appends the tasks
            that it keeps.
        familiar: tasks that count as solved. Solved tasks may be proposed again, but do not count as requested tasks.
        refused: reasons why the criteria of proposed tasks were refused, by name of the task. The run adds further
            reasons.
    """

    settings: RobotSummary
    classes: Mapping[str, Affordance]
    known: Sequence[Known] = ()
    familiar: Sequence[TaskSpec] = ()
    refused: Mapping[str, str] = field(default_factory=dict)

    def of(self, task: TaskSpec) -> dict[str, Affordance]:
        """Return the affordance of each object of a task, by its name in the task."""
        return {name: self.classes[thing.asset_class] for name, thing in task.objects.items()}


@dataclass(frozen=True)
class Candidate:
    """A candidate solution of a task: the strategies that a designer suggests for each step.

    Attributes:
        label: phrase that describes the candidate in the report.
        steps: strategies by name for each step, preferred strategies first. Steps may share strategies. Kept tasks use
            these names.
        provenance: origin of the strategies: search parameters, or prompt and answer.
        labels: phrase that describes a strategy, by its name. Strategies whose names describe them are not included.
    """

    label: str
    steps: dict[str, Strategies]
    provenance: dict[str, Any]
    labels: Mapping[str, str] = field(default_factory=dict)

    @property
    def strategies(self) -> Strategies:
        """Return the strategies of all steps by name, as a task folder stores them."""
        return {name: data for strategies in self.steps.values() for name, data in strategies.items()}

    def described(self, strategy: str) -> str:
        """Return the label of a strategy, or its name if it has no label.

        The result is empty if the label already describes the candidate.
        """
        label = self.labels.get(strategy, strategy)
        return "" if label == self.label else label

    def of(self, task: TaskSpec) -> TaskSpec:
        """Return a copy of ``task`` whose steps refer to this candidate's strategies."""
        return with_strategies(task, self.steps)


@dataclass(frozen=True)
class StageResult:
    """Result of a candidate in one stage of the search.

    Attributes:
        name: name of the stage.
        trials: number of trials, which are planned scenes (stage ``"plan"``) or simulated episodes (stage
            ``"physics"``).
        score: fraction of trials in which the plan is complete or the episode succeeds.
        causes: number of failures by cause.
        strict: fraction of episodes that also pass the strict verdict; 0 without episodes.
        diagnoses: descriptions of failures with measured values, the most frequent first.
        by_object: number of successful episodes and of all episodes, by instance id of the task's first object.
    """

    name: Literal["plan", "physics"]
    trials: int
    score: float
    causes: dict[str, int]
    strict: float = 0.0
    diagnoses: tuple[Diagnosis, ...] = field(default=())
    by_object: Mapping[str, tuple[int, int]] = field(default_factory=dict)


@dataclass(frozen=True)
class CandidateResult:
    """A candidate and its results in each stage of the search so far."""

    candidate: Candidate
    stages: tuple[StageResult, ...]

    @property
    def physics_score(self) -> float:
        """Success rate over all simulated episodes, reduced if there are few episodes."""
        return self.held / (self.episodes + 1)

    @property
    def strict_score(self) -> float:
        """Fraction of simulated episodes that pass `strict`, reduced if there are few episodes."""
        return self.strict / (self.episodes + 1)

    @property
    def episodes(self) -> int:
        """Number of simulated episodes over all stages."""
        return sum(stage.trials for stage in self._physics)

    @property
    def held(self) -> float:
        """Number of simulated episodes, over all stages, that succeeded (the `held` verdict)."""
        return sum(stage.score * stage.trials for stage in self._physics)

    @property
    def strict(self) -> float:
        """Number of simulated episodes, over all stages, that pass the `strict` verdict."""
        return sum(stage.strict * stage.trials for stage in self._physics)

    @property
    def by_object(self) -> dict[str, tuple[int, int]]:
        """Number of successful episodes and of all episodes in all stages, by id of the task's first object."""
        found: dict[str, tuple[int, int]] = {}
        for stage in self._physics:
            for instance, (held, count) in stage.by_object.items():
                before = found.get(instance, (0, 0))
                found[instance] = (before[0] + held, before[1] + count)
        return dict(sorted(found.items()))

    @property
    def diagnoses(self) -> tuple[Diagnosis, ...]:
        """Descriptions of the failures in the latest stage in which a trial failed."""
        return next((stage.diagnoses for stage in reversed(self.stages) if stage.diagnoses), ())

    @property
    def _physics(self) -> list[StageResult]:
        return [stage for stage in self.stages if stage.name == "physics"]

    @property
    def plan_score(self) -> float:
        """Fraction of scenes in which the candidate has a complete plan."""
        plans = [stage for stage in self.stages if stage.name == "plan"]
        return plans[-1].score if plans else 0.0


class Designer(Protocol):
    """Interface of a designer, which proposes tasks and candidate strategies, and refines candidates by their results.

    Attributes:
        name: name of the designer in run.json and in the provenance of its tasks.
        notes: remarks for the report. The run reads the remarks at its end.
        patience: number of refinements after which a search may give up a task if nearly all episodes still fail.
            Designers that learn from failures need more than one.
    """

    @property
    def name(self) -> str: ...

    @property
    def notes(self) -> Sequence[str]: ...

    @property
    def patience(self) -> int: ...

    def open(self, folder: Path) -> None:
        """Set the run folder in which the designer stores its records; called once, before all other methods."""
        ...

    def propose(self, brief: Brief, seed: int) -> Iterable[TaskSpec]:
        """Yield new tasks, the most useful first; no task repeats a known task.

        Each task states its origin in its provenance. Its steps have placeholders for the names of a candidate's
        strategies.
        """
        ...

    def candidates(self, task: TaskSpec, brief: Brief, seed: int) -> list[Candidate]:
        """Return the first candidate strategies for a task.

        Raises:
            Declined: the designer has no candidate for the task.
        """
        ...

    def refine(
        self, task: TaskSpec, brief: Brief, results: Sequence[CandidateResult], seed: int, round: int
    ) -> list[Candidate]:
        """Return new candidates, the most promising first, based on earlier results; an empty list ends the search."""
        ...

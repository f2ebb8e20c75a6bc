"""The designer interface, implemented by the offline search and by language models."""

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
    """A designer has no candidate for a task; the task is rejected and the run continues."""


@dataclass(frozen=True)
class RobotSummary:
    """Facts about the robot that a designer needs.

    Attributes:
        robot: name of the robot.
        base: x and y of the robot's base in the world, m. The table's top is at z = 0, and x points away from the
            robot.
        reach: horizontal distance in metres from the base within which the hand, pointing down, reaches the table.
        stroke: maximum opening of the gripper, m between the pads.
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
        task: task spec.
        strategies: strategies of its steps, by name.
        held, episodes: successful and total episodes of its last verification; zero if unknown.
    """

    task: TaskSpec
    strategies: Strategies
    held: int = 0
    episodes: int = 0


@dataclass(frozen=True)
class Brief:
    """Input of a designer: the robot, the objects and the existing tasks.

    Attributes:
        settings: facts about the robot.
        classes: affordance of each articulated or rigid class, by class name.
        known: existing tasks. A proposal must not repeat one of them, and long tasks may be built from them. The run
            appends each task that it keeps, so a designer that yields proposals one by one can build on earlier ones.
    """

    settings: RobotSummary
    classes: Mapping[str, Affordance]
    known: Sequence[Known] = ()
    familiar: Sequence[TaskSpec] = ()

    def of(self, task: TaskSpec) -> dict[str, Affordance]:
        """Return the affordance of each object of a task, by its name in the task."""
        return {name: self.classes[thing.asset_class] for name, thing in task.objects.items()}


@dataclass(frozen=True)
class Candidate:
    """Strategies that a designer suggests for all steps of a task.

    Attributes:
        label: phrase for the report.
        steps: strategies by name for each step, in order of preference. A kept task uses these names. Steps may share a
            strategy.
        provenance: search parameters, or prompt and answer.
    """

    label: str
    steps: dict[str, Strategies]
    provenance: dict[str, Any]

    @property
    def strategies(self) -> Strategies:
        """Return the strategies of all steps by name, as a task folder stores them."""
        return {name: data for strategies in self.steps.values() for name, data in strategies.items()}

    def of(self, task: TaskSpec) -> TaskSpec:
        """Return the task whose steps name this candidate's strategies."""
        return with_strategies(task, self.steps)


@dataclass(frozen=True)
class StageResult:
    """Result of a candidate in one stage of the search.

    Attributes:
        name: stage name.
        trials: number of planned scenes or of episodes.
        score: share of trials with a complete plan, or share of successful episodes.
        causes: number of failures by cause.
        strict: share of episodes that also pass the strict verdict; 0 without episodes.
        diagnoses: failures in words with numbers, the most frequent first.
    """

    name: Literal["plan", "physics"]
    trials: int
    score: float
    causes: dict[str, int]
    strict: float = 0.0
    diagnoses: tuple[Diagnosis, ...] = field(default=())


@dataclass(frozen=True)
class CandidateResult:
    """A candidate with its results in all stages so far."""

    candidate: Candidate
    stages: tuple[StageResult, ...]

    @property
    def physics_score(self) -> float:
        """Success rate over all simulated episodes, shrunk towards zero if there are few episodes."""
        return self.held / (self.episodes + 1)

    @property
    def strict_score(self) -> float:
        """Strict success rate over all simulated episodes, shrunk towards zero if there are few episodes."""
        return self.strict / (self.episodes + 1)

    @property
    def episodes(self) -> int:
        """Number of simulated episodes over all stages."""
        return sum(stage.trials for stage in self._physics)

    @property
    def held(self) -> float:
        """Number of successful episodes over all stages."""
        return sum(stage.score * stage.trials for stage in self._physics)

    @property
    def strict(self) -> float:
        """Number of episodes that pass the strict verdict, over all stages."""
        return sum(stage.strict * stage.trials for stage in self._physics)

    @property
    def diagnoses(self) -> tuple[Diagnosis, ...]:
        """Diagnoses of the last stage that has any."""
        return next((stage.diagnoses for stage in reversed(self.stages) if stage.diagnoses), ())

    @property
    def _physics(self) -> list[StageResult]:
        return [stage for stage in self.stages if stage.name == "physics"]

    @property
    def plan_score(self) -> float:
        """Share of scenes with a complete plan."""
        plans = [stage for stage in self.stages if stage.name == "plan"]
        return plans[-1].score if plans else 0.0


class Designer(Protocol):
    """Interface of a designer: it proposes tasks, writes candidates and refines them by their results.

    Attributes:
        name: recorded in run.json and as the origin of the designer's tasks.
        notes: remarks for the reader of the report; read at the end of the run.
    """

    @property
    def name(self) -> str: ...

    @property
    def notes(self) -> Sequence[str]: ...

    def open(self, folder: Path) -> None:
        """Store the designer's own records in the run folder; called once, before any other method."""
        ...

    def propose(self, brief: Brief, seed: int) -> Iterable[TaskSpec]:
        """Yield new tasks, best first; no task repeats a known one.

        Each task names its origin in its provenance. Each step names at least one placeholder strategy, which
        candidates replace.
        """
        ...

    def candidates(self, task: TaskSpec, brief: Brief, seed: int) -> list[Candidate]:
        """Return the first candidates for a task.

        Raises:
            Declined: the designer has no candidate for the task.
        """
        ...

    def refine(
        self, task: TaskSpec, brief: Brief, results: Sequence[CandidateResult], seed: int, round: int
    ) -> list[Candidate]:
        """Return new candidates in view of earlier results, best first; an empty list ends the search."""
        ...

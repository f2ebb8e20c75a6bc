"""The interface of a designer, whether a search or a language model stands behind it."""

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

DESIGNED = "designed"
"""Name of the strategy that a designer writes for a step."""


class Declined(GenSim2Error):
    """A designer has nothing for a task; the task is rejected with this reason, and the run goes on."""


@dataclass(frozen=True)
class RobotSummary:
    """The robot, as far as a designer needs to know.

    Attributes:
        robot: its name.
        base: x and y of its base in the world, m; the table's top is at z = 0, x points away from the robot.
        reach: horizontal distance (m) from the base within which the hand, pointing down, reaches the table.
        stroke: most that the fingers open, m between the pads.
        tool_keypoints: name to description.
    """

    robot: str
    base: tuple[float, float]
    reach: float
    stroke: float
    tool_keypoints: dict[str, str]


@dataclass(frozen=True)
class Known:
    """A task that is there already.

    Attributes:
        task: its spec.
        strategies: how its steps are done, by name.
        held, episodes: of its last verification; zero where it is unknown.
    """

    task: TaskSpec
    strategies: Strategies
    held: int = 0
    episodes: int = 0


@dataclass(frozen=True)
class Brief:
    """All that a designer is told.

    Attributes:
        settings: of the robot.
        classes: what each class of objects affords, articulated and rigid, by class name.
        known: tasks that are there: nothing proposed may repeat one, and long tasks can be made of them. A run adds
            what it keeps while it goes on, so a designer that yields its proposals one by one can build on them.
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
    """One way to do a task.

    Attributes:
        label: a phrase for the report.
        steps: for each step of the task its strategies by name, in order of preference. The task that is kept names
            them so, whatever names its proposal had. Steps may share one.
        provenance: how it came about (search parameters, or prompt and answer).
    """

    label: str
    steps: dict[str, Strategies]
    provenance: dict[str, Any]

    @property
    def strategies(self) -> Strategies:
        """Those of all steps by name, as a task's folder holds them."""
        return {name: data for strategies in self.steps.values() for name, data in strategies.items()}

    def of(self, task: TaskSpec) -> TaskSpec:
        """The task with its steps' strategies named as here."""
        return with_strategies(task, self.steps)


@dataclass(frozen=True)
class StageResult:
    """Result of a candidate in one stage of the search.

    Attributes:
        name: of the stage.
        trials: scenes planned, or episodes.
        score: share of them that were planned whole, or held.
        causes: counts of what went wrong.
        strict: share of the episodes that meet the strict verdict as well; 0 where none was run.
        diagnoses: what went wrong, in words with numbers, the most frequent first.
    """

    name: Literal["plan", "physics"]
    trials: int
    score: float
    causes: dict[str, int]
    strict: float = 0.0
    diagnoses: tuple[Diagnosis, ...] = field(default=())


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
        """Number of them that held."""
        return sum(stage.score * stage.trials for stage in self._physics)

    @property
    def strict(self) -> float:
        """Number of them that meet the strict verdict."""
        return sum(stage.strict * stage.trials for stage in self._physics)

    @property
    def diagnoses(self) -> tuple[Diagnosis, ...]:
        """Diagnoses of the last stage that had any."""
        return next((stage.diagnoses for stage in reversed(self.stages) if stage.diagnoses), ())

    @property
    def _physics(self) -> list[StageResult]:
        return [stage for stage in self.stages if stage.name == "physics"]

    @property
    def plan_score(self) -> float:
        """Share of scenes in which a whole plan was found."""
        plans = [stage for stage in self.stages if stage.name == "plan"]
        return plans[-1].score if plans else 0.0


class Designer(Protocol):
    """Proposes tasks, writes candidates, and learns from how they fared.

    Attributes:
        name: stands in run.json, and as the origin of its tasks.
        notes: what a reader of the run should know; read when the run ends.
    """

    @property
    def name(self) -> str: ...

    @property
    def notes(self) -> Sequence[str]: ...

    def open(self, folder: Path) -> None:
        """Called once, before anything else, with the run's folder: for records of the designer's own."""
        ...

    def propose(self, brief: Brief, seed: int) -> Iterable[TaskSpec]:
        """Yield new tasks, best first, of one or several steps and objects; none repeats a known one.

        Their provenance says who proposes them. Their steps name at least one strategy each, which candidates replace.
        """
        ...

    def candidates(self, task: TaskSpec, brief: Brief, seed: int) -> list[Candidate]:
        """Return the first round of candidates for a task.

        Raises:
            Declined: the designer has nothing for it.
        """
        ...

    def refine(
        self, task: TaskSpec, brief: Brief, results: Sequence[CandidateResult], seed: int, round: int
    ) -> list[Candidate]:
        """Return new candidates given how earlier ones fared, best first; an empty list ends the search."""
        ...

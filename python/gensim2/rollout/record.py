"""Record of an episode that is over: one plain value, as JSON in logs, for tables, designers and reports."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from typing import Annotated, Any, ClassVar, Literal

from pydantic import ConfigDict, Field, FiniteFloat

from gensim2.core.renamed import current
from gensim2.tasks.presets import DEFAULT_PRESET

SCHEMA_VERSION: Literal[2] = 2


START = "start"
"""Trigger of the plans that a step begins with."""


class Cause(StrEnum):
    """Why an episode does not count as ``held``: the first thing that went wrong and was not made good."""

    INVALID_PROBLEM = "invalid problem"
    NO_ACTUATION_POSE = "no actuation pose"
    KEYFRAME_OUT_OF_REACH = "keyframe out of reach"
    COLLISION_ON_THE_WAY = "collision on the way"
    NO_MOTION_FOUND = "no motion found"
    NO_GRASP = "no grasp to be had"
    CONTACT_SLIPPED = "contact slipped"
    NO_CONTACT = "object did not move"
    WRONG_WAY = "pushed the wrong way"
    STOPPED_SHORT = "stopped short"
    GRASP_MISSED = "grasp missed"
    GRASP_LOST = "grasp lost"
    OBJECT_DRIFTED = "object drifted"
    PLACED_BESIDE = "placed beside the goal"
    GOAL_UNDONE = "goal undone after release"
    HAPPENS_BY_ITSELF = "happens in the no-op baseline"
    TIME_OVER = "time over"
    STILL_MOVING = "still moving when judged"
    UNSTABLE = "physics became unstable"

    @classmethod
    def _missing_(cls, value: object) -> Cause | None:
        name = current(str(value), _RENAMED, "cause")
        return None if name == value else cls(name)


_RENAMED = {"happens with a still arm": "happens in the no-op baseline"}
"""Today's causes by those of the release before."""


class StrictMiss(StrEnum):
    """Reason for which an episode is not ``strict``."""

    NOT_HELD = "not held"
    NOT_LET_GO = "the hand has not let go"
    NOT_RETREATED = "the hand has not retreated"
    NOT_LASTING = "goal undone a second later"
    MOVING = "still moving a second later"
    DISTURBED = "moved before the actuation pose"
    NOT_INSIDE = "not inside the container"
    OTHERS_MOVED = "another object moved"
    PRESSED_IN = "pressed into something"


@dataclass(frozen=True)
class ObjectRecord:
    """Object on the table and its pose: every draw of the episode.

    Attributes:
        asset_class, id, source, content_hash: which object.
        pose: (7,) of its root in the world at the start: x, y, z, qw, qx, qy, qz.
        yaw: rad that the randomization turned it by.
        openness_start, openness_end: of its joint; None of a rigid object, or where it is no number any more.
        pose_end: (7,) of a rigid object at the end; None of an articulated one or where it is no number any more.
        default_pose: physics preset of the default pose that was randomized (earlier files: ``"ours"``);
            None: its pose was given.
        mass_factor, contact_friction_factor, joint_friction_factor: by what its physics was multiplied.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid", strict=True)

    asset_class: str
    id: str
    source: str
    content_hash: str
    pose: list[FiniteFloat]
    yaw: FiniteFloat
    openness_start: FiniteFloat | None
    openness_end: FiniteFloat | None
    pose_end: list[FiniteFloat] | None = None
    default_pose: str | None = None
    mass_factor: FiniteFloat = 1.0
    contact_friction_factor: FiniteFloat = 1.0
    joint_friction_factor: FiniteFloat = 1.0


@dataclass(frozen=True)
class PlanRecord:
    """One plan that was made, and what became of it.

    Attributes:
        strategy: its name.
        status, reason: the planner's.
        at_step: control step at which it was made.
        trigger: why: ``"start"``, or the deviation that led to it.
        ran: control steps for which it was followed.
        detail: what a designer learns from: residuals that are not met, the keyframe not reached, colliding bodies,
            distances (m or rad). Empty where it is solved.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid", strict=True)

    strategy: str
    status: str
    reason: str
    at_step: Annotated[int, Field(ge=0)]
    trigger: str
    ran: Annotated[int, Field(ge=0)]
    detail: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class StepRecord:
    """One step of the task.

    Attributes:
        name: of the step.
        plans: in order; more than one where something deviated or a strategy failed.
        paper: its criterion was true at some control step of its turn (true where it has none).
        done: its criterion was true when its turn ended.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid", strict=True)

    name: str
    plans: list[PlanRecord]
    paper: bool
    done: bool

    @property
    def partial(self) -> bool:
        """Whether a part of a motion was executed because the whole could not be had."""
        return any(plan.status == "partial" for plan in self.plans)

    @property
    def replans(self) -> int:
        """Plans that something led to after the step had begun; other strategies tried at its start are none."""
        return sum(plan.trigger != START for plan in self.plans)


@dataclass(frozen=True)
class AttemptRecord:
    """One of several attempts from the same start.

    Attributes:
        seed: of the solver.
        first: strategy that a step began with in place of its own first one, by step.
        paper, held, strict, cause: as of an episode.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid", strict=True)

    seed: Annotated[int, Field(ge=0)]
    first: dict[str, str]
    paper: bool
    held: bool
    strict: bool
    cause: Cause | None


@dataclass(frozen=True)
class Episode:
    """One episode: one reset, whatever was planned and tried inside it.

    Attributes:
        seed: of the reset.
        objects: by name.
        placement_draws: draws until all stood apart and within reach.
        steps: those that were begun.
        control_steps: executed, settling included.
        paper: each step's criterion was true at some control step of its turn.
        held: the goal is true at the end with the scene at rest, and not in the no-op baseline.
        strict: see docs/reference/episodes.md; ``strict_misses`` says what it lacks.
        still: whether the goal holds in the no-op baseline; None where that did not need to be run.
        settled: the scene was at rest when it was judged; it is not held where it was not.
        truncated: the episode was longer than the task allows.
        cause: why it does not count as held; None where it does.
        diagnosis: numbers beside the cause and beside each miss of the strict verdict, for a designer and a report.
        randomization: name of the preset that the scene was drawn with.
        start: (n,) all active joints of the robot at the start.
        attempts: where several were allowed, all that were made from this start, in order; everything else is of one of
            them (:mod:`gensim2.rollout.run`).
        disturbed_at: control step at which it was disturbed; None where it was not.
        index: place of the episode in its log or data set; -1 outside of one. Comparisons of episodes ignore it.
        episode_digest: digest of the episode's file; None where no file was kept.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid", strict=True)

    seed: int
    objects: dict[str, ObjectRecord]
    placement_draws: Annotated[int, Field(ge=1)]
    steps: list[StepRecord]
    control_steps: Annotated[int, Field(ge=0)]
    paper: bool
    held: bool
    strict: bool
    strict_misses: list[StrictMiss]
    still: bool | None
    settled: bool
    truncated: bool
    cause: Cause | None
    diagnosis: dict[str, Any] = field(default_factory=dict)
    randomization: str = DEFAULT_PRESET
    start: list[FiniteFloat] = field(default_factory=list)
    attempts: list[AttemptRecord] = field(default_factory=list)
    disturbed_at: Annotated[int, Field(ge=0)] | None = None
    index: Annotated[int, Field(ge=0)] = field(default=-1, compare=False)
    episode_digest: str | None = None

    def at(self, index: int, episode_digest: str | None = None) -> Episode:
        """Return the same episode at a place of a log or data set."""
        return replace(self, index=index, episode_digest=episode_digest)

    @property
    def partial(self) -> bool:
        """Whether any step executed a part of a motion."""
        return any(step.partial for step in self.steps)

    @property
    def replans(self) -> int:
        """Plans that something led to after a step had begun."""
        return sum(step.replans for step in self.steps)

    def to_dict(self) -> dict[str, Any]:
        """Return the record as plain data, without the episode's place."""
        told = asdict(self)
        del told["index"], told["episode_digest"]
        return told

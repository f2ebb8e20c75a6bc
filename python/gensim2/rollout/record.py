"""Record a finished episode as plain data, for logs, tables, design and reports."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from typing import Annotated, Any, ClassVar, Literal

from pydantic import ConfigDict, Field, FiniteFloat

from gensim2.core.renamed import current
from gensim2.scenes.physics import Engine
from gensim2.tasks.presets import DEFAULT_PRESET

SCHEMA_VERSION: Literal[2] = 2


START = "start"
"""Value of ``PlanRecord.trigger`` for plans made at the start of a step."""


class Cause(StrEnum):
    """Reason why an episode is not a success by the verdict ``held``: the first fault that was not corrected."""

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
    OBJECT_NOT_SEEN = "object not seen"
    FORCE_LIMIT = "force limit reached"
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
"""Current names of causes, by their names in the previous release."""


class StrictMiss(StrEnum):
    """Reason why an episode is not a success by the verdict ``strict``."""

    NOT_HELD = "not held"
    NOT_LET_GO = "the hand has not let go"
    NOT_RETREATED = "the hand has not retreated"
    NOT_LASTING = "goal undone a second later"
    MOVING = "still moving a second later"
    DISTURBED = "moved before the actuation pose"
    # Only records of old versions have this value. In later versions, the goal itself requires the object in the
    # container.
    NOT_INSIDE = "not inside the container"
    OTHERS_MOVED = "another object moved"
    PRESSED_IN = "pressed into something"


@dataclass(frozen=True)
class ObjectRecord:
    """An object of the episode, with its pose and its random physical properties.

    Attributes:
        asset_class, id, source, content_hash: identity of the object.
        pose: (7,) pose of the object's root in the world frame at the start: x, y, z (m), qw, qx, qy, qz.
        yaw: random rotation about the vertical, rad.
        openness_start, openness_end: openness of the joint at start and end; None for a rigid object or if not finite.
        pose_end: (7,) pose of a rigid object at the end; None for an articulated object or if not finite.
        default_pose: pose before the displacement: ``"default"`` (formerly ``"ours"``) or ``"original"``. None if the
            pose was given.
        mass_factor, contact_friction_factor, joint_friction_factor: random factors on mass and friction.
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
    """A plan and its execution.

    Attributes:
        strategy: name of the planned strategy.
        status, reason: result of the planner.
        at_step: control step at which the plan was made.
        trigger: ``"start"``, or the deviation that caused replanning.
        ran: number of control steps executed.
        detail: measured values of a failed planning, in m or rad, such as residuals, an unreachable keyframe or
            colliding bodies. Empty after a success.
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
    """Record of one step of the task.

    Attributes:
        plans: plans, oldest first. There is more than one plan after a deviation or a failed strategy.
        paper: whether the criterion of the step was met at any time during the step (verdict ``paper``). True if it has
            no criterion.
        done: whether the step's criterion was met when the step ended.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid", strict=True)

    name: str
    plans: list[PlanRecord]
    paper: bool
    done: bool

    @property
    def partial(self) -> bool:
        """Return whether only part of a motion was executed because no complete plan was found."""
        return any(plan.status == "partial" for plan in self.plans)

    @property
    def replans(self) -> int:
        """Return the number of plans after the start of the step. Plans that only compare strategies do not count."""
        return sum(plan.trigger != START for plan in self.plans)


@dataclass(frozen=True)
class AttemptRecord:
    """Record of one attempt, when an episode has several attempts from the same initial scene.

    Attributes:
        seed: seed of the solver.
        first: strategies that were tried first in place of the default strategy, by name of the step.
        paper, held, strict, cause: as in :class:`Episode`.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid", strict=True)

    seed: Annotated[int, Field(ge=0)]
    first: dict[str, str]
    paper: bool
    held: bool
    strict: bool
    cause: Cause | None


@dataclass(frozen=True)
class EngineRecord:
    """Verdicts on an episode in one of two physics engines, from the same initial scene.

    Attributes:
        engine: physics engine.
        paper, held, strict, cause: as in :class:`Episode`.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid", strict=True)

    engine: Engine
    paper: bool
    held: bool
    strict: bool
    cause: Cause | None


@dataclass(frozen=True)
class Episode:
    """Record of an episode, from the reset of the scene to its evaluation.

    Attributes:
        seed: seed of the reset.
        objects: objects by name.
        placement_draws: number of samples until all objects were apart and within reach.
        steps: steps that were started.
        control_steps: number of executed control steps, including the steps in which the scene came to rest.
        paper: ``paper`` verdict: each step's criterion was met at some control step of this step.
        held: verdict ``held``: the goal holds at the end, with the scene at rest, and does not hold in the no-op
            baseline.
        strict: verdict ``strict`` (docs/reference/episodes.md). ``strict_misses`` lists the conditions that are not
            met.
        still: whether the goal holds in the no-op baseline, without the arm. None if the baseline was not needed.
        settled: whether the scene was at rest when the episode was evaluated. The ``held`` verdict requires this.
        truncated: whether the episode was longer than the task allows.
        cause: reason why the episode does not pass ``held``; None if it passes.
        diagnosis: measured values that describe the cause and each unmet condition of the ``strict`` verdict.
        randomization: name of the scene's randomization preset.
        start: (n,) all active joints of the robot at the start.
        attempts: all attempts from the same start, in order, if several attempts were allowed. All other fields
            describe the attempt that counts (:func:`gensim2.rollout.run.attempted`).
        disturbed_at: control step of the disturbance; None without a disturbance.
        engines: verdicts by engine if the episode ran in two engines, which must both pass; else empty. In this case,
            ``cause``, ``diagnosis``, ``strict_misses`` and ``still`` come from the first engine that fails, and other
            fields from the first engine.
        index: position in the log or data set, or -1. Comparisons of episodes ignore it.
        episode_digest: SHA-256 of the episode's file; None without a file.
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
    engines: list[EngineRecord] = field(default_factory=list)
    index: Annotated[int, Field(ge=0)] = field(default=-1, compare=False)
    episode_digest: str | None = None

    def at(self, index: int, episode_digest: str | None = None) -> Episode:
        """Return this episode with a position in a log or data set."""
        return replace(self, index=index, episode_digest=episode_digest)

    @property
    def partial(self) -> bool:
        """Return whether any step executed only part of a motion."""
        return any(step.partial for step in self.steps)

    @property
    def replans(self) -> int:
        return sum(step.replans for step in self.steps)

    def to_dict(self) -> dict[str, Any]:
        """Return the record as plain data, without the episode's position."""
        told = asdict(self)
        del told["index"], told["episode_digest"]
        return told


def in_all_engines(found: Mapping[Engine, Episode]) -> Episode:
    """Combine the episodes of one scene in several engines; the result passes a verdict only if all episodes pass it.

    Args:
        found: episode by engine. The first episode provides the plans and the objects.
    """
    episodes = list(found.values())
    failed = (each for verdict in ("held", "strict") for each in episodes if not getattr(each, verdict))
    deciding = next(failed, episodes[0])
    return replace(
        episodes[0],
        paper=all(each.paper for each in episodes),
        held=all(each.held for each in episodes),
        strict=all(each.strict for each in episodes),
        strict_misses=deciding.strict_misses,
        still=deciding.still,
        cause=deciding.cause,
        diagnosis=deciding.diagnosis,
        engines=[
            EngineRecord(engine, each.paper, each.held, each.strict, each.cause) for engine, each in found.items()
        ],
    )

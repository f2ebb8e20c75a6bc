"""Define the task specification: an immutable, validated value that can be converted to YAML and JSON.

A task has named objects and steps. A step is one interaction with an actuation pose at an object, motions before and
after this pose, and a gripper command. The spec has only the names of strategies, which are in
``strategies/<name>.yaml``.
"""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from gensim2.tasks.criteria import JOINT, Criterion, JointCriterion

SCHEMA_VERSION: Literal[2] = 2

STEPS_A_SECOND = 20
"""Steps per second in the unit of ``max_episode_steps``. With another control rate, the time limit in seconds is the
same.
"""

HAND = "hand"
"""Reserved name of the robot's own tool."""
TABLE = "table"
"""Reserved name of the default support of objects."""
DESIGNED = "designed"
"""Name of the strategy that a designer writes for a step."""
Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$", max_length=60)]
"""Name of an object, a step or a strategy."""
Share = Annotated[float, Field(ge=0, le=1)]

FARTHEST = 5.0
"""Maximum distance in metres from the world's origin along x or y; the table ends at 0.65."""
Coordinate = Annotated[float, Field(ge=-FARTHEST, le=FARTHEST)]

_NO_TEXT = re.compile("[\x00-\x08\x0e-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
"""Control characters, and characters that change the text direction."""


def _text(text: str) -> str:
    odd = _NO_TEXT.search(text)
    if odd is not None:
        raise ValueError(f"the text contains a control character ({odd[0]!a})")
    return text


def _pair(value: Any) -> Any:
    """Expand a single number w to the range (-w, w). Return a range, given as a pair, unchanged."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return (-value, value)
    return tuple(value) if isinstance(value, list) else value  # pydantic's strict mode expects a tuple


def _ordered(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] > pair[1]:
        raise ValueError("the first number of a range must not exceed the second")
    return pair


Offset = Annotated[
    tuple[Annotated[float, Field(ge=-1, le=1)], Annotated[float, Field(ge=-1, le=1)]],
    BeforeValidator(_pair),
    AfterValidator(_ordered),
]
"""Range of an offset, m; in files also a single number, meaning minus to plus that number."""


Words = Annotated[tuple[str, ...], Field(min_length=1, max_length=1000)]
"""Instances of a class, as in ``--instances``."""


class _Value(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True, serialize_by_alias=True)


class Place(_Value):
    """Placement of an object before randomization.

    Attributes:
        on: ``"table"``, or the name of the object that supports or contains this object.
        at: x and y in the world, m; None: the default placement, or the middle of the supporting object.
        yaw: rotation from the default placement about the vertical, rad.
    """

    on: Name = TABLE
    at: tuple[Coordinate, Coordinate] | None = None
    yaw: Annotated[float, Field(ge=-6.2832, le=6.2832)] = 0.0


class Randomization(_Value):
    """Ranges of an object's initial pose and openness, in m and rad.

    The edges of the table are 0.65 m from the origin.

    The yaw is random up to the absolute value of ``yaw``. Its direction depends on the side of the y offset: the object
    turns towards the robot if ``yaw`` is positive, and away from it if ``yaw`` is negative.

    Attributes:
        x, y: offset from the object's place, m; a single number w stands for the range from -w to w.
        yaw: limit of the rotation about the vertical, rad. The rotation has the sign of the sampled y offset, or
            the opposite sign if ``yaw`` is negative.
        openness_mean: mean openness at the start; None: default of the instance.
        openness_spread: maximum deviation from the mean openness. The sampled openness is clipped to 0..1.
    """

    x: Offset = (-0.1, 0.1)
    y: Offset = (-0.1, 0.1)
    yaw: Annotated[float, Field(ge=-6.2832, le=6.2832)] = 0.5235987755982988
    openness_mean: Share | None = None
    openness_spread: Share = 0.15


class ObjectSpec(_Value):
    """An object of a task.

    Attributes:
        asset_class: name of the class; a rigid object has a class of its own with one instance, such as ``golf_ball``.
        instances: allowed instances, as in ``--instances``, or a mapping with ``real`` and ``generated``; None: all
            instances. A run can restrict them further.
        place: placement before randomization.
        randomization: ranges of placement and openness.
    """

    asset_class: Annotated[str, Field(alias="class", max_length=100)]
    instances: Words | dict[Literal["generated", "real"], Words] | None = None
    place: Place = Place()
    randomization: Randomization = Randomization()

    def words(self, source: str) -> tuple[str, ...] | None:
        """Return the allowed instances of the source ``"real"`` or ``"generated"``.

        None: all instances of the class.
        """
        return self.instances.get(source) if isinstance(self.instances, dict) else self.instances  # type: ignore[call-overload]


class Step(_Value):
    """One interaction with an object: an actuation pose, the motions before and after it, and a gripper command.

    Attributes:
        name: name, unique in the task.
        object: object to move, to grasp, or to approach with the tool.
        tool: ``"hand"``, or the grasped object, whose keypoints then replace the keypoints of the hand.
        strategies: names of strategies in order of preference; strategies of a language model are named ``designed``.
        done: criteria that must all hold at some time during the step for the verdict ``paper``. A step without
            criteria counts as done as soon as it starts. In the paper, grasps and releases are such steps.
    """

    name: Name
    object: Name
    tool: Name = HAND
    strategies: Annotated[tuple[Name, ...], Field(min_length=1, max_length=20)] = (DESIGNED,)
    done: Annotated[tuple[Criterion, ...], Field(max_length=20)] = ()


class Made(_Value):
    """Origin of a strategy.

    Attributes:
        by: ``"search"``, ``"model"`` (a language model) or ``"hand"`` (a person).
        seen: objects with which the strategy was designed: ``"train"`` for the training split only, or ``"all"``.
    """

    by: Literal["search", "model", "hand"]
    seen: Literal["train", "all"]


class Verified(_Value):
    """Result of a verification.

    The verification ran episodes with the strategies on scenes that the design did not use.

    Attributes:
        episodes: number of episodes.
        held: number of episodes that are successes according to the verdict ``held``.
        paper: number of successes according to the verdict ``paper``; None in files of earlier releases.
        strict: number of successes according to the verdict ``strict``; None in files of earlier releases.
        interval: 95 % confidence interval of the success rate.
        seed: seed of the run; the scenes are ``gensim2.core.seeding.scene_seeds(seed, name, "verify", episodes)``.
        instances: split of the objects; the search used no object of the splits ``new`` and ``test``.
        objects: number of different objects by class.
    """

    episodes: Annotated[int, Field(ge=1)]
    held: Annotated[int, Field(ge=0)]
    paper: Annotated[int, Field(ge=0)] | None = None
    strict: Annotated[int, Field(ge=0)] | None = None
    interval: tuple[Share, Share]
    seed: Annotated[int, Field(ge=0)]
    instances: Literal["new", "test", "all"]
    objects: dict[str, Annotated[int, Field(ge=1)]]

    @model_validator(mode="after")
    def _figures_go_together(self) -> Self:
        low, high = self.interval
        if self.held > self.episodes or not low - 1e-6 <= self.share <= high + 1e-6:
            raise ValueError("the fields 'held', 'episodes' and 'interval' contradict each other")
        if (self.strict or 0) > self.held or (self.paper or 0) > self.episodes:
            raise ValueError("'strict' must not exceed 'held', and 'paper' must not exceed 'episodes'")
        return self

    @property
    def share(self) -> float:
        """Fraction of episodes that pass the verdict ``held``."""
        return self.held / self.episodes


class Provenance(_Value):
    """Provenance of a task.

    Attributes:
        origin: ``"paper"`` for tasks of the paper's tables, otherwise the name of the designer.
        strategies: origin of each strategy by name.
        prompts: hexadecimal SHA-256 of the prompts, if a language model designed the task.
        verification: result of the task's verification.
    """

    origin: Annotated[str, Field(min_length=1, max_length=100)]
    strategies: dict[Name, Made] = {}
    prompts: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")] | None = None
    verification: Verified | None = None


class TaskSpec(_Value):
    """A task with one or several objects.

    Attributes:
        name: name in CamelCase; the name of the environment is ``GenSim2-<name>-v1``.
        description: instruction in everyday words, as one phrase in lower case.
        objects: objects by name, in the order in which they are placed.
        steps: steps in the order of execution.
        goal: criteria that must all hold at the end. None: the criteria in ``done`` of the last step are the goal.
        max_episode_steps: maximum duration of an episode, in steps of 1 / ``STEPS_A_SECOND`` s.
        provenance: origin and verification of the task; None if unknown.
    """

    schema_version: Literal[2] = 2
    name: Annotated[str, Field(pattern=r"^[A-Z][A-Za-z0-9]*$", max_length=100)]
    description: Annotated[str, Field(max_length=1000), AfterValidator(_text)]
    objects: Annotated[dict[Name, ObjectSpec], Field(min_length=1, max_length=20)]
    steps: Annotated[tuple[Step, ...], Field(min_length=1, max_length=50)]
    goal: Annotated[tuple[Criterion, ...], Field(min_length=1, max_length=20)] | None = None
    max_episode_steps: Annotated[int, Field(gt=0, le=10_000)] = 400
    provenance: Provenance | None = None

    @property
    def max_seconds(self) -> float:
        """Time limit of an episode in seconds, independent of the robot's control rate."""
        return self.max_episode_steps / STEPS_A_SECOND

    @model_validator(mode="after")
    def _names_are_known(self) -> Self:
        for reserved in (HAND, TABLE):
            if reserved in self.objects:
                raise ValueError(f"no object may have the name {reserved!r}, which is reserved")
        before: list[str] = [TABLE]
        for name, spec in self.objects.items():
            if spec.place.on not in before:
                raise ValueError(f"objects.{name}.place.on: no object before {name!r} has the name {spec.place.on!r}")
            before.append(name)
        if len({step.name for step in self.steps}) < len(self.steps):
            raise ValueError("two steps have the same name")
        if self.goal is None and not self.steps[-1].done:
            raise ValueError("goal: is required, because the field 'done' of the last step is empty")
        for step in self.steps:
            for field, name in (("object", step.object), ("tool", step.tool)):
                if name not in self.objects and not (field == "tool" and name == HAND):
                    raise ValueError(f"steps.{step.name}.{field}: there is no object {name!r}")
        ways = {name for step in self.steps for name in step.strategies}
        for name in () if self.provenance is None else self.provenance.strategies:
            if name not in ways:
                raise ValueError(f"provenance.strategies: no step has a strategy {name!r}")
        for criterion in (*self.success, *(c for step in self.steps for c in step.done)):
            for name in criterion.objects:
                if name not in self.objects:
                    raise ValueError(f"a criterion {criterion.type} names an unknown object {name!r}")
        return self

    @property
    def success(self) -> tuple[Criterion, ...]:
        """Criteria that must hold at the end: ``goal``, or the last step's ``done``."""
        return self.steps[-1].done if self.goal is None else self.goal

    @property
    def acted_on(self) -> frozenset[str]:
        """Names of the objects that are touched on purpose: the object of each step, and the object in the hand."""
        return frozenset(name for step in self.steps for name in (step.object, step.tool) if name != HAND)

    @property
    def transient(self) -> frozenset[str]:
        """Steps whose result a later step undoes. The final state does not show that these steps were done.

        If a step between opening and closing a drawer puts an object in or takes it out, the final place of the object
        shows that the drawer was open. The first step is then left out.
        """
        return frozenset(
            step.name
            for first, step in enumerate(self.steps)
            for second, later in enumerate(self.steps[first + 1 :], first + 1)
            if later.object == step.object
            and (moved := self.motion_of(step)) is not None
            and (back := self.motion_of(later)) is not None
            and back.type != moved.type
            and not any(self.uses(between, step.object) for between in self.steps[first + 1 : second])
        )

    def motion_of(self, step: Step) -> JointCriterion | None:
        """Return the criterion on the joint of the step's object, such as an open drawer, or None if there is none."""
        criteria = step.done or (self.success if step is self.steps[-1] else ())
        return next((c for c in criteria if isinstance(c, JOINT) and c.object == step.object), None)

    def uses(self, step: Step, container: str) -> bool:
        """Return whether a step puts an object into or onto ``container``, or grasps an object that starts there."""
        puts = step.object == container and step.tool != HAND and self.motion_of(step) is None
        return puts or (step.tool == HAND and self.objects[step.object].place.on == container)

    @property
    def is_single_step(self) -> bool:
        """Whether the task has exactly one step."""
        return len(self.steps) == 1

    @property
    def env_id(self) -> str:
        """Id of the task's environment, for ``gymnasium.make``."""
        return f"GenSim2-{self.name}-v1"

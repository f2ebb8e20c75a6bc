"""A long task in the making, and whether its steps follow from one another.

Taking something up needs an empty hand and leaves it full; putting it down needs a full hand and what it is put into
open, and leaves the hand empty; a joint is not brought to where it stands (:func:`chains`).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple, TypeVar

from gensim2.design.base import DESIGNED, Brief, Known
from gensim2.design.proposals import joint_goal
from gensim2.objects.words import End, words
from gensim2.tasks.criteria import ArticulatedClosed, ArticulatedOpen, Criterion, DistanceGripperRigid
from gensim2.tasks.spec import HAND, ObjectSpec, Provenance, Randomization, Step, TaskSpec
from gensim2.tasks.strategies import Strategies

ENDS = ("articulated_open", "articulated_closed")


class Piece(NamedTuple):
    """A known task that brings a joint to one of its ends."""

    asset_class: str
    goal: End
    known: Known


def pieces(brief: Brief) -> list[Piece]:
    """Return the known ones on classes that the library has, the most useful first."""
    goals = [(joint_goal(known.task), known) for known in brief.known]
    found = [
        Piece(goal[0], goal[1], known)  # type: ignore[arg-type]
        for goal, known in goals
        if goal is not None and goal[1] in ENDS and has_joint(brief, goal[0])
    ]
    return sorted(found, key=lambda each: -words(each.asset_class, each.goal).usefulness)


def has_joint(brief: Brief, asset_class: str) -> bool:
    """Return whether the library has a class of this name whose objects have a joint; known tasks may be on others."""
    return asset_class in brief.classes and brief.classes[asset_class].kind == "articulated"


def is_known(brief: Brief, asset_class: str, goal: str) -> bool:
    """Whether there is a piece for this class and goal."""
    return any((each.asset_class, each.goal) == (asset_class, goal) for each in pieces(brief))


def piece_ways(brief: Brief, asset_class: str, goal: str) -> Strategies:
    """Return the strategies by which a known task brings a joint to ``goal``, under telling names; empty where none is
    known."""
    for known in brief.known:
        if joint_goal(known.task) == (asset_class, goal):
            wanted = known.task.steps[0].strategies
            return {_own_name(name, known.task): known.strategies[name] for name in wanted}
    return {}


def _own_name(strategy: str, task: TaskSpec) -> str:
    """A name that no other piece has, where a designer gave none."""
    (thing,) = task.objects.values()
    number = strategy.removeprefix(DESIGNED)
    return f"{task.steps[0].name}_{thing.asset_class}{number}" if number != strategy else strategy


Item = TypeVar("Item")

#: Tasks that differ in nothing but the rigid object.
ALIKE = 3

#: Control steps that a step of a long task is given.
STEPS_EACH = 300

#: Where a rigid object waits beside what it is put into, x and y in the world, and what is drawn about it.
BESIDE, OTHER_SIDE = (-0.2, -0.45), (-0.2, 0.45)
ABOUT = Randomization(x=(-0.1, 0.1), y=(-0.1, 0.1))
CLOSE_ABOUT = Randomization(x=(-0.05, 0.05), y=(-0.05, 0.05))

#: Where two things with joints stand beside each other, x and y in the world, and by how much they are turned.
PAIRED = (((-0.05, 0.3), -0.4), ((-0.05, -0.3), 0.4))


@dataclass
class Draft:
    """A task in the making.

    Attributes:
        name, sentence: of the task.
        objects: by name, in the order in which they are placed.
        steps: in order.
        goal: what must hold in the end.
    """

    name: str
    sentence: str
    objects: dict[str, ObjectSpec] = field(default_factory=dict)
    steps: list[Step] = field(default_factory=list)
    goal: list[Criterion] = field(default_factory=list)

    def joint(self, verb: str, role: str, criterion: Criterion, lasting: bool = True) -> None:
        """A step that works a joint."""
        self._step(f"{verb}_{role}", role, HAND, (criterion,))
        if lasting:
            self.goal.append(criterion)

    def grasp(self, role: str) -> None:
        """A step that takes something up."""
        self._step(f"grasp_{role}", role, HAND, (DistanceGripperRigid(rigid=role),))

    def put(self, verb: str, role: str, where: str, criterion: Criterion) -> None:
        """A step that puts down what is held."""
        self._step(f"{verb}_{role}", where, role, (criterion,))
        self.goal.append(criterion)

    def task(self) -> TaskSpec:
        """As a value."""
        return TaskSpec(
            name=self.name,
            description=self.sentence,
            objects=self.objects,
            steps=tuple(self.steps),
            goal=tuple(self.goal),
            max_episode_steps=STEPS_EACH * len(self.steps),
            provenance=Provenance(origin="offline"),
        )

    def _step(self, name: str, role: str, tool: str, done: tuple[Criterion, ...]) -> None:
        self.steps.append(Step(name=name[:60], object=role, tool=tool, strategies=(DESIGNED,), done=done))


Family = Callable[[Brief], Iterator[Draft]]
"""Drafts of one kind, as far as they can be made of what is known."""


def chains(task: TaskSpec) -> list[str]:
    """List the preconditions that steps of a chain need and the steps before them do not establish."""
    held: str | None = None
    openness: dict[str, str] = {}
    wrong = []
    for step in task.steps:
        if step.tool != (held or HAND):
            wrong.append(f"{step.name}: the hand holds {held or 'nothing'}")
        rigid = {name for criterion in step.done for name in criterion.objects if name not in openness}
        if step.tool != HAND:
            if openness.get(step.object) == "closed":
                wrong.append(f"{step.name}: {step.object} is closed")
            held = None
        for criterion in step.done:
            if isinstance(criterion, ArticulatedOpen | ArticulatedClosed):
                state = "open" if isinstance(criterion, ArticulatedOpen) else "closed"
                if openness.get(criterion.object) == state:
                    wrong.append(f"{step.name}: {criterion.object} is {state} already")
                openness[criterion.object] = state
            elif isinstance(criterion, DistanceGripperRigid) and step.object in rigid:
                held = step.object
    if held is not None:
        wrong.append(f"the hand still holds {held}")
    return wrong


def verbs(task: TaskSpec) -> tuple[str, ...]:
    """The chain of verbs of a task: the first word of each step."""
    return tuple(step.name.split("_")[0] for step in task.steps)


def in_turn(queues: Iterable[Iterable[Item]]) -> Iterator[Item]:
    """The first of each, then the second of each, and so on."""
    for row in itertools.zip_longest(*queues):
        yield from (item for item in row if item is not None)

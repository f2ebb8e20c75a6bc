"""Draft tasks of several steps, and check that earlier steps establish each step's preconditions.

A step that picks up an object needs an empty hand. A step that puts an object down needs the object in the hand and an
open container. A step that moves a joint must change its openness.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple, TypeVar

from gensim2.design.base import Brief, Known
from gensim2.objects.words import End, words
from gensim2.tasks.criteria import ArticulatedClosed, ArticulatedOpen, Criterion, DistanceGripperRigid
from gensim2.tasks.likeness import joint_goal
from gensim2.tasks.spec import DESIGNED, HAND, ObjectSpec, Provenance, Randomization, Step, TaskSpec
from gensim2.tasks.strategies import Strategies

ENDS = ("articulated_open", "articulated_closed")


class Piece(NamedTuple):
    """A known task that moves a joint to one end of its range, used as a step of longer tasks."""

    asset_class: str
    goal: End
    known: Known


def pieces(brief: Brief) -> list[Piece]:
    """Return the known joint tasks whose object class is in the library, the most useful first."""
    goals = [(joint_goal(known.task), known) for known in brief.known]
    found = [
        Piece(goal[0], goal[1], known)  # type: ignore[arg-type]
        for goal, known in goals
        if goal is not None and goal[1] in ENDS and has_joint(brief, goal[0])
    ]
    return sorted(found, key=lambda each: -words(each.asset_class, each.goal).usefulness)


def has_joint(brief: Brief, asset_class: str) -> bool:
    """Return whether the library has this articulated class, so that a known task may use it."""
    return asset_class in brief.classes and brief.classes[asset_class].kind == "articulated"


def is_known(brief: Brief, asset_class: str, goal: str) -> bool:
    """Return whether a known task moves this class's joint to ``goal``."""
    return any((each.asset_class, each.goal) == (asset_class, goal) for each in pieces(brief))


def piece_ways(brief: Brief, asset_class: str, goal: str) -> Strategies:
    """Return the strategies of the known task that moves the joint of this class to ``goal``.

    The result is empty without such a task.
    """
    for known in brief.known:
        if joint_goal(known.task) == (asset_class, goal):
            wanted = known.task.steps[0].strategies
            return {_own_name(name, known.task): known.strategies[name] for name in wanted}
    return {}


def _own_name(strategy: str, task: TaskSpec) -> str:
    """Return the name of a strategy for longer tasks.

    A name ``designed...`` becomes a name of the step and the class.
    """
    (thing,) = task.objects.values()
    number = strategy.removeprefix(DESIGNED)
    return f"{task.steps[0].name}_{thing.asset_class}{number}" if number != strategy else strategy


Item = TypeVar("Item")

#: Maximum number of tasks that differ only in the rigid object.
ALIKE = 3

#: Number of control steps by which each step of a long task extends the task's time limit.
STEPS_EACH = 300

#: Start positions (x, y) of rigid objects, m: to the right of the destination as seen from the robot, and to the left.
BESIDE, OTHER_SIDE = (-0.2, -0.45), (-0.2, 0.45)

#: Ranges (m) of the random offsets from start positions. ``CLOSE_ABOUT`` is for several rigid objects.
ABOUT = Randomization(x=(-0.1, 0.1), y=(-0.1, 0.1))
CLOSE_ABOUT = Randomization(x=(-0.05, 0.05), y=(-0.05, 0.05))

#: Poses ((x, y) in m, yaw in rad) of two articulated objects that stand side by side.
PAIRED = (((-0.05, 0.3), -0.4), ((-0.05, -0.3), 0.4))


@dataclass
class Draft:
    """A task under construction.

    Attributes:
        name, sentence: name and description of the task.
        objects: objects by name, in the order in which they are placed.
        steps: steps in order.
        goal: criteria that must hold at the end.
    """

    name: str
    sentence: str
    objects: dict[str, ObjectSpec] = field(default_factory=dict)
    steps: list[Step] = field(default_factory=list)
    goal: list[Criterion] = field(default_factory=list)

    def joint(self, verb: str, role: str, criterion: Criterion, lasting: bool = True) -> None:
        """Add a step that moves a joint.

        Args:
            lasting: whether the criterion of the step must also be true at the end of the task.
        """
        self._step(f"{verb}_{role}", role, HAND, (criterion,))
        if lasting:
            self.goal.append(criterion)

    def grasp(self, role: str) -> None:
        """Add a step that picks up an object."""
        self._step(f"grasp_{role}", role, HAND, (DistanceGripperRigid(rigid=role),))

    def put(self, verb: str, role: str, where: str, criterion: Criterion) -> None:
        """Add a step that puts the grasped object down."""
        self._step(f"{verb}_{role}", where, role, (criterion,))
        self.goal.append(criterion)

    def task(self) -> TaskSpec:
        """Return the finished task spec."""
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
"""Function that yields all drafts of one kind that are possible with the brief's classes and known tasks."""


def chains(task: TaskSpec) -> list[str]:
    """Return a message for each precondition of a step that earlier steps do not establish.

    An example is an open container.
    """
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
    """Return the first word of each step's name."""
    return tuple(step.name.split("_")[0] for step in task.steps)


def in_turn(queues: Iterable[Iterable[Item]]) -> Iterator[Item]:
    """Yield the first item of each queue, then the second of each, and so on."""
    for row in itertools.zip_longest(*queues):
        yield from (item for item in row if item is not None)

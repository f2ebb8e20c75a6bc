"""Propose single-step tasks from an object's joint, openness and size, in everyday words."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any

from gensim2.design.affordance import Affordance
from gensim2.objects.words import GOALS, Direction, Goal, Phrase, camel_case, halfway, handled, in_ascii, words
from gensim2.tasks.criteria import (
    CLOSED,
    OPEN,
    ArticulatedBetween,
    ArticulatedClosed,
    ArticulatedOpen,
    Criterion,
    RigidLifted,
    RigidMoved,
)
from gensim2.tasks.likeness import joint_goal
from gensim2.tasks.spec import DESIGNED, HAND, TABLE, ObjectSpec, Place, Provenance, Randomization, Step, TaskSpec

#: A task with a lower usefulness than this is proposed only if no task with a higher usefulness is left.
ASKED_FOR = 0.5

#: Maximum deviation of the initial openness from its mean, as in the paper's scenes.
OPENNESS_SPREAD = 0.15

#: Mean and maximum deviation of the initial openness, of objects that start closed and of objects that start open.
SHUT_AT, OPEN_AT = (0.05, 0.05), (0.95, 0.05)

#: Height (m) by which an object must rise. The default grasp lifts an object twice as high.
LIFT = 0.06

#: ``RIGID`` is the number of tasks that differ only in the rigid object. They are ordered by
#: ``RIGID_USEFUL``, their usefulness (0 to 1).
RIGID, RIGID_USEFUL = 3, 0.8

#: Ways to hand an object over: name, sentence, and start position (x, y) in the world, m.
HANDING: dict[Direction, tuple[str, str, tuple[float, float]]] = {
    "left": ("Hand{}ToTheLeft", "hand the {} to the person on the left", (-0.1, 0.0)),
    "right": ("Hand{}ToTheRight", "hand the {} to the person on the right", (-0.1, 0.0)),
    "away": ("Hand{}Across", "hand the {} to the person across the table", (-0.15, 0.0)),
}


def goal_of(task: TaskSpec) -> str:
    """Return one phrase with the types of the criteria that must hold at the end."""
    return ", ".join(criterion.type for criterion in task.success)


def spec(thing: Affordance, goal: Goal, origin: str = "offline") -> TaskSpec:
    """Return a task with one object, of the class of ``thing``, and one step, which moves its joint to ``goal``."""
    phrase = phrase_of(thing, goal)
    assert phrase is not None, f"no phrase asks for {thing.asset_class} to be {goal}"
    role = role_of(phrase.noun)
    return TaskSpec(
        name=phrase.name,
        description=phrase.sentence,
        objects={role: ObjectSpec(asset_class=thing.asset_class, randomization=start(thing, goal))},
        steps=(
            Step(
                name=phrase.sentence.split()[0], object=role, strategies=(DESIGNED,), done=(criterion_of(role, goal),)
            ),
        ),
        provenance=Provenance(origin=origin),
    )


def phrase_of(thing: Affordance, goal: Goal) -> Phrase | None:
    """Return the usual phrase for a joint goal, such as "open the drawer", or None if there is no usual phrase."""
    if goal in ("half_open", "half_closed"):
        return halfway(thing.asset_class, goal)
    return words(thing.asset_class, goal, thing.joint_type or "revolute")  # type: ignore[arg-type]


def criterion_of(role: str, goal: Goal) -> Criterion:
    """Return the success criterion that is met when the joint of the object named ``role`` has reached ``goal``."""
    if goal == "articulated_open":
        return ArticulatedOpen(object=role)
    return ArticulatedClosed(object=role) if goal == "articulated_closed" else ArticulatedBetween(object=role)


def start(thing: Affordance, goal: Goal, **given: Any) -> Randomization:
    """Return the random ranges of the initial state, in which ``goal`` is never met at the start.

    The joint starts in the default range of openness of its class if the goal is not met there, and otherwise at the
    opposite end. For a half-way goal, it starts closed or open.
    """
    if goal in ("half_open", "half_closed") or not _undone(thing, goal):
        mean, spread = SHUT_AT if goal in ("articulated_open", "half_open") else OPEN_AT
        return Randomization(openness_mean=mean, openness_spread=spread, **given)
    return Randomization(**given)


def goals(thing: Affordance) -> list[Goal]:
    """Return the joint goals that make sense as tasks for a class of objects.

    A goal is included only if people commonly ask for it. For a part that slides vertically, closing and half-way goals
    are included only if the part starts open, because such a part falls shut by itself.
    """
    hangs = thing.joint_type == "prismatic" and thing.joint_axis == "vertical"
    return [
        goal
        for goal in GOALS
        if phrase_of(thing, goal) is not None and (goal == "articulated_open" or not hangs or _undone(thing, goal))
    ]


def lift(thing: Affordance, origin: str = "offline") -> TaskSpec:
    """Return the task of picking up a rigid object."""
    role = role_of(thing.noun)
    return TaskSpec(
        name=f"PickUp{camel_case(thing.noun)}",
        description=f"pick up the {thing.noun}",
        objects={role: ObjectSpec(asset_class=thing.asset_class, randomization=Randomization())},
        steps=(
            Step(name="pick_up", object=role, strategies=(DESIGNED,), done=(RigidLifted(rigid=role, height=LIFT),)),
        ),
        provenance=Provenance(origin=origin),
    )


def hand_over(thing: Affordance, direction: Direction, origin: str = "offline") -> TaskSpec:
    """Return the task of handing over a rigid object."""
    role = role_of(thing.noun)
    name, sentence, at = HANDING[direction]
    about = Randomization(x=(-0.05, 0.05), y=(-0.05, 0.05))
    done = (RigidMoved(rigid=role, direction=direction), RigidLifted(rigid=role, height=LIFT / 2))
    return TaskSpec(
        name=name.format(camel_case(thing.noun)),
        description=sentence.format(thing.noun),
        objects={role: ObjectSpec(asset_class=thing.asset_class, place=Place(at=at), randomization=about)},
        steps=(Step(name="hand_over", object=role, strategies=(DESIGNED,), done=done),),
        provenance=Provenance(origin=origin),
    )


def propose(
    classes: Mapping[str, Affordance],
    known: Iterable[TaskSpec],
    stroke: float,
    familiar: Iterable[TaskSpec] = (),
    wanted: Collection[tuple[str, str]] = (),
) -> Iterator[TaskSpec]:
    """Yield single-step tasks that ``known`` lacks, each with a new name.

    The tasks are ordered as follows:

    - First come tasks that are steps of longer tasks (``wanted``).
    - Then comes the most useful task of each class. If opening and closing are equally useful, the classes alternate
      between opening and closing.
    - Then come all other tasks by usefulness.
    - Tasks that people rarely ask for (usefulness below ``ASKED_FOR``) come last.

    Args:
        known: existing tasks.
        stroke: maximum opening of the gripper, m.
        familiar: tasks that are proposed only if ``wanted`` contains their goal.
        wanted: joint goals (class and goal) that longer tasks use as steps.
    """
    known = list(known)
    names = {task.name for task in known}
    taken = {joint_goal(task) for task in known}
    taken |= {reached for task in familiar if (reached := joint_goal(task)) is not None and reached not in wanted}
    first: list[TaskSpec] = []
    later: list[tuple[float, TaskSpec]] = []
    opening: Goal = "articulated_open"
    for thing in classes.values():
        if thing.kind == "rigid" or not thing.lever_arms:
            continue
        fresh = [(_usefulness(thing, goal), goal) for goal in goals(thing) if (thing.asset_class, goal) not in taken]
        fresh.sort(key=lambda choice: (-choice[0], choice[1] != opening))
        for rank, (usefulness, goal) in enumerate(fresh):
            task = spec(thing, goal)
            if task.name in names:
                continue
            names.add(task.name)
            if rank == 0 and usefulness >= ASKED_FOR:
                first.append(task)
                opening = "articulated_closed" if goal == "articulated_open" else "articulated_open"
            else:
                later.append((usefulness, task))
    later += [
        (RIGID_USEFUL, task) for task in (*_lifts(classes, stroke), *_handed(classes, stroke)) if task.name not in names
    ]
    later.sort(key=lambda choice: -choice[0])
    yield from sorted([*first, *(task for _, task in later)], key=lambda task: joint_goal(task) not in wanted)


def redesigned(task: TaskSpec, name: str | None = None) -> TaskSpec:
    """Return the task without its solution, so that a designer can solve it again.

    Each step keeps the name of one strategy, for a new strategy. The provenance keeps only ``origin``.

    Args:
        name: name for the strategy of every step; None: keep the name of each step's first strategy.
    """
    steps = tuple(
        step.model_copy(update={"strategies": step.strategies[:1] if name is None else (name,)}) for step in task.steps
    )
    provenance = None if task.provenance is None else Provenance(origin=task.provenance.origin)
    return task.model_copy(update={"steps": steps, "provenance": provenance})


def holdable(thing: Affordance, stroke: float) -> bool:
    """Return whether a rigid object fits between two fingers and is thick enough to be grasped from a table."""
    return thing.kind == "rigid" and 0.0 < (thing.grip_width or 0.0) < stroke - 0.005 and thing.size[2] > 0.015


def role_of(noun: str) -> str:
    """Return a valid object name for a task, made from ``noun``; a reserved noun gets an article."""
    role = in_ascii(noun).lower().replace(" ", "_").replace("'", "")[:50]
    return f"the_{role}" if role in (HAND, TABLE) or not role[0].isalpha() else role


def _lifts(classes: Mapping[str, Affordance], stroke: float) -> list[TaskSpec]:
    things = [classes[name] for name in handled("lifted") if name in classes and holdable(classes[name], stroke)]
    return [lift(thing) for thing in things[:RIGID]]


def _handed(classes: Mapping[str, Affordance], stroke: float) -> list[TaskSpec]:
    things = [classes[name] for name in handled("handed over") if name in classes and holdable(classes[name], stroke)]
    return [hand_over(thing, direction) for direction in HANDING for thing in things[:RIGID]]


def _usefulness(thing: Affordance, goal: Goal) -> float:
    phrase = phrase_of(thing, goal)
    return 0.0 if phrase is None else phrase.usefulness


def _undone(thing: Affordance, goal: Goal) -> bool:
    """Return whether the goal is unmet wherever the joint starts within its default range of openness."""
    openness = thing.default_openness or 0.0
    if goal == "articulated_open":
        return openness + OPENNESS_SPREAD < OPEN
    return openness - OPENNESS_SPREAD > CLOSED

"""Which tasks an object affords, by its joint and its openness alone, in the words of people."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from gensim2.designers.base import DESIGNED, Affordance, Goal
from gensim2.objects.words import words
from gensim2.tasks.criteria import CLOSED, OPEN, ArticulatedClosed, ArticulatedOpen
from gensim2.tasks.spec import HAND, TABLE, ObjectSpec, Provenance, Step, TaskSpec

#: Usefulness of a phrase below which a task is proposed only when nothing better is left.
ASKED_FOR = 0.5

#: Half the width of the band from which the initial openness is drawn, as in the paper's scenes.
OPENNESS_SPREAD = 0.15


def affordance_of(task: TaskSpec) -> tuple[str, Goal] | None:
    """Return which class a task brings to which end of its joint; None for a task that is something else."""
    if not task.is_single_step or len(task.success) != 1:
        return None
    criterion = task.success[0]
    if not isinstance(criterion, ArticulatedOpen | ArticulatedClosed):
        return None
    return task.objects[criterion.object].asset_class, criterion.type


def goal_of(task: TaskSpec) -> str:
    """Return the types of the criteria that must hold in the end, in one phrase."""
    return ", ".join(criterion.type for criterion in task.success)


def spec(affordance: Affordance, goal: Goal) -> TaskSpec:
    """Return the task of bringing an object of this class to ``goal``: one object, one step, in people's words."""
    phrase = words(affordance.asset_class, goal, affordance.joint_type)
    role = _role(phrase.noun)
    done = ArticulatedOpen(object=role) if goal == "articulated_open" else ArticulatedClosed(object=role)
    return TaskSpec(
        name=phrase.name,
        description=phrase.sentence,
        objects={role: ObjectSpec(asset_class=affordance.asset_class)},
        steps=(Step(name=phrase.sentence.split()[0], object=role, strategies=(DESIGNED,), done=(done,)),),
    )


def _role(noun: str) -> str:
    """A noun as an object's name in a task; what a task cannot call an object gets an article."""
    role = noun.replace(" ", "_")[:50]
    return f"the_{role}" if role in (HAND, TABLE) or not role[0].isalpha() else role


def redesigned(task: TaskSpec) -> TaskSpec:
    """Return the task with one strategy a step, under the name of the first, which a designer is to write: how the
    former ones came about is not said of it.
    """
    steps = tuple(step.model_copy(update={"strategies": step.strategies[:1]}) for step in task.steps)
    provenance = None if task.provenance is None else Provenance(origin=task.provenance.origin)
    return task.model_copy(update={"steps": steps, "provenance": provenance})


def goals(affordance: Affordance) -> list[Goal]:
    """Return the goals that every start leaves undone, given the spread of the initial openness."""
    possible: list[Goal] = []
    if affordance.default_openness + OPENNESS_SPREAD < OPEN:
        possible.append("articulated_open")
    if affordance.default_openness - OPENNESS_SPREAD > CLOSED:
        possible.append("articulated_closed")
    return possible


def propose(affordances: Iterable[Affordance], known: Sequence[TaskSpec]) -> Iterator[TaskSpec]:
    """Yield tasks that ``known`` lacks, no two of one name.

    First one a class, its most useful one, opening and closing in turn where both are as useful; then the other goals,
    the most useful ones first. What hardly anybody would ask for (below ``ASKED_FOR``) comes last.
    """
    taken = {affordance_of(task) for task in known}
    names = {task.name for task in known}
    later: list[tuple[float, TaskSpec]] = []
    wanted: Goal = "articulated_open"
    for affordance in affordances:
        if not affordance.keypoints:
            continue
        fresh = [
            (words(affordance.asset_class, goal, affordance.joint_type).usefulness, goal)
            for goal in goals(affordance)
            if (affordance.asset_class, goal) not in taken
        ]
        fresh.sort(key=lambda choice: (-choice[0], choice[1] != wanted))
        for rank, (usefulness, goal) in enumerate(fresh):
            task = spec(affordance, goal)
            if task.name in names:
                continue
            names.add(task.name)
            if rank == 0 and usefulness >= ASKED_FOR:
                yield task
                wanted = "articulated_closed" if goal == "articulated_open" else "articulated_open"
            else:
                later.append((usefulness, task))
    yield from (task for _, task in sorted(later, key=lambda choice: -choice[0]))

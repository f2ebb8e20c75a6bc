"""Which tasks an object affords, by its joint and its openness alone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from gensim2.designers.base import DESIGNED, Affordance, Goal
from gensim2.tasks.criteria import CLOSED, OPEN, ArticulatedClosed, ArticulatedOpen
from gensim2.tasks.spec import ObjectSpec, Step, TaskSpec

#: Endings of class names that say how the object moves; they are not part of the object's noun.
MOTION_WORDS = {
    "rotate": ("Open", "Close"),
    "move": ("Move", "Return"),
    "lift": ("Lift", "Lower"),
    "press": ("Press", "Release"),
    "push": ("Push", "PushBack"),
    "swing": ("Swing", "SwingBack"),
    "cap": ("Open", "Close"),
}

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


def _words(asset_class: str, goal: Goal) -> tuple[str, list[str]]:
    """The verb in CamelCase, and the words of the noun."""
    words = asset_class.split("_")
    verbs = ("Open", "Close")
    if len(words) > 1 and words[-1] in MOTION_WORDS:
        verbs = MOTION_WORDS[words[-1]]
        words = words[:-1]
    return verbs[goal == "articulated_closed"], words


def task_name(asset_class: str, goal: Goal) -> str:
    """Return a CamelCase name, for example ``OpenWashingMachine``."""
    verb, noun = _words(asset_class, goal)
    return verb + "".join(word.capitalize() for word in noun)


def spec(affordance: Affordance, goal: Goal) -> TaskSpec:
    """Return the task of bringing an object of this class to ``goal``: one object, one step."""
    opening = goal == "articulated_open"
    verb, words = _words(affordance.asset_class, goal)
    noun, role = affordance.asset_class.replace("_", " "), "_".join(words)
    done = ArticulatedOpen(object=role) if opening else ArticulatedClosed(object=role)
    return TaskSpec(
        name=task_name(affordance.asset_class, goal),
        description=f"{'open' if opening else 'close'} the {noun}"
        if affordance.joint_type == "revolute"
        else f"slide the {noun} {'out to the end of' if opening else 'back along'} its joint",
        objects={role: ObjectSpec(asset_class=affordance.asset_class)},
        steps=(Step(name=_snake(verb), object=role, strategies=(DESIGNED,), done=(done,)),),
    )


def redesigned(task: TaskSpec) -> TaskSpec:
    """Return the task with one strategy a step, under the name of the first, which a designer is to write."""
    steps = tuple(step.model_copy(update={"strategies": step.strategies[:1]}) for step in task.steps)
    return task.model_copy(update={"steps": steps})


def _snake(word: str) -> str:
    """``PushBack`` as ``push_back``."""
    return "".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in word).lstrip("_")


def goals(affordance: Affordance) -> list[Goal]:
    """Return the goals that every start leaves undone, given the spread of the initial openness."""
    possible: list[Goal] = []
    if affordance.default_openness + OPENNESS_SPREAD < OPEN:
        possible.append("articulated_open")
    if affordance.default_openness - OPENNESS_SPREAD > CLOSED:
        possible.append("articulated_closed")
    return possible


def propose(affordances: Iterable[Affordance], known: Sequence[TaskSpec]) -> Iterator[TaskSpec]:
    """Yield tasks that ``known`` lacks: one a class first, opening and closing in turn, then the other goals."""
    taken = {affordance_of(task) for task in known}
    names = {task.name for task in known}
    second: list[TaskSpec] = []
    wanted: Goal = "articulated_open"
    for affordance in affordances:
        if not affordance.keypoints:
            continue
        fresh = [goal for goal in goals(affordance) if (affordance.asset_class, goal) not in taken]
        fresh.sort(key=lambda goal: goal != wanted)
        tasks = [task for task in (spec(affordance, goal) for goal in fresh) if task.name not in names]
        if not tasks:
            continue
        yield tasks[0]
        opened = isinstance(tasks[0].success[0], ArticulatedOpen)
        wanted = "articulated_closed" if opened else "articulated_open"
        second.extend(tasks[1:])
    yield from second

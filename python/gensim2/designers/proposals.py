"""Which tasks an object affords, by its joint and its openness alone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from gensim2.designers.base import Affordance, Goal
from gensim2.tasks.spec import Criterion, TaskSpec

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

#: Openness beyond which a goal counts as reached, as in the paper's success criteria.
OPEN_THRESHOLD = 0.8
CLOSED_THRESHOLD = 0.2

#: Half the width of the band from which the initial openness is drawn, as in the paper's scenes.
OPENNESS_SPREAD = 0.15


def goal_of(task: TaskSpec) -> Goal:
    """Return the goal that names the task: its first criterion."""
    return task.success[0].type


def task_name(asset_class: str, goal: Goal) -> str:
    """Return a CamelCase name, for example ``OpenWashingMachine``."""
    words = asset_class.split("_")
    verbs = ("Open", "Close")
    if len(words) > 1 and words[-1] in MOTION_WORDS:
        verbs = MOTION_WORDS[words[-1]]
        words = words[:-1]
    return verbs[goal == "articulated_closed"] + "".join(word.capitalize() for word in words)


def spec(affordance: Affordance, goal: Goal) -> TaskSpec:
    """Return the task of bringing an object of this class to ``goal``."""
    opening = goal == "articulated_open"
    noun = affordance.asset_class.replace("_", " ")
    return TaskSpec(
        name=task_name(affordance.asset_class, goal),
        description=f"{'open' if opening else 'close'} the {noun}"
        if affordance.joint_type == "revolute"
        else f"slide the {noun} {'out to the end of' if opening else 'back along'} its joint",
        asset_class=affordance.asset_class,
        success=(Criterion(type=goal, threshold=OPEN_THRESHOLD if opening else CLOSED_THRESHOLD),),
    )


def goals(affordance: Affordance) -> list[Goal]:
    """Return the goals that every start leaves undone, given the spread of the initial openness."""
    possible: list[Goal] = []
    if affordance.default_openness + OPENNESS_SPREAD < OPEN_THRESHOLD:
        possible.append("articulated_open")
    if affordance.default_openness - OPENNESS_SPREAD > CLOSED_THRESHOLD:
        possible.append("articulated_closed")
    return possible


def propose(affordances: Iterable[Affordance], known: Sequence[TaskSpec]) -> Iterator[TaskSpec]:
    """Yield tasks that ``known`` lacks: one a class first, opening and closing in turn, then the other goals."""
    taken = {(task.asset_class, goal_of(task)) for task in known}
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
        wanted = "articulated_closed" if goal_of(tasks[0]) == "articulated_open" else "articulated_open"
        second.extend(tasks[1:])
    yield from second

"""Long tasks made of what is known by its pre- and post-conditions, in the words of people."""

from __future__ import annotations

from collections.abc import Iterator

from gensim2.design import chores, containers, serving
from gensim2.design.base import Brief
from gensim2.design.drafting import Family, chains
from gensim2.design.pieces import ENDS
from gensim2.objects.words import belongs
from gensim2.tasks.likeness import first_alike
from gensim2.tasks.spec import TaskSpec

#: Kinds of long tasks, each a function of what is known; they take turns in this order.
FAMILIES: list[Family] = [
    chores.FAMILIES["pairs"],
    serving.FAMILIES["serve"],
    containers.FAMILIES["drop"],
    chores.FAMILIES["to and fro"],
    containers.FAMILIES["shut"],
    chores.FAMILIES["errands"],
    containers.FAMILIES["take out"],
    chores.FAMILIES["pairs"],
    serving.FAMILIES["serve two"],
    containers.FAMILIES["put"],
    containers.FAMILIES["take out and close"],
    containers.FAMILIES["stow"],
    chores.FAMILIES["pairs"],
    serving.FAMILIES["lay"],
    containers.FAMILIES["move over"],
    containers.FAMILIES["open and take out"],
    containers.FAMILIES["move over and close"],
    containers.FAMILIES["fill and close"],
    containers.FAMILIES["fill"],
]


def propose(brief: Brief) -> Iterator[TaskSpec | None]:
    """Yield long tasks that can be made of what is known, families in turn, none of a name that is there, and none that
    is no news.

    What is known is looked at when a task's turn has come, so that what a run keeps meanwhile counts. None: there is
    nothing new for now.
    """
    proposed: set[str] = set()
    while True:
        fresh = False
        for family in FAMILIES:
            taken = proposed | {known.task.name for known in brief.known}
            task = next((draft.task() for draft in family(brief) if draft.name not in taken), None)
            if task is None:
                continue
            fresh = True
            proposed.add(task.name)
            assert not chains(task), f"{task.name}: {chains(task)}"
            if first_alike(task, brief.familiar) is None:
                yield task
        if not fresh:
            yield None


def wanted_ends(brief: Brief) -> set[tuple[str, str]]:
    """Classes and goals that long tasks are made of."""
    kept_in = {name for name, thing in brief.classes.items() if thing.is_container and belongs(name)}
    return chores.wanted_ends() | {(name, end) for name in kept_in for end in ENDS}

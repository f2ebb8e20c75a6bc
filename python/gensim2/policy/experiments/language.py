"""Replacements of a task's sentence: the opposite, or the same in other words."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gensim2.core.errors import InputError
from gensim2.core.yaml_files import read_yaml
from gensim2.tasks.criteria import ArticulatedClosed, ArticulatedOpen
from gensim2.tasks.spec import TaskSpec

SENTENCES = Path(__file__).parent / "sentences.yaml"


def opposites(tasks: Sequence[TaskSpec]) -> dict[str, str]:
    """By a task's sentence that of the task which wants the same joint of the same class at its other end.

    Args:
        tasks: of one policy. Scenes of both begin alike, so that the sentence alone tells them apart.
    """
    ends = {(name, opens): task.description for task in tasks for name, opens in [_end(task)] if name is not None}
    return {sentence: ends[name, not opens] for (name, opens), sentence in ends.items() if (name, not opens) in ends}


def _end(task: TaskSpec) -> tuple[str | None, bool]:
    """Class of the only object of a task and whether its joint is opened; None where that is not the goal."""
    things, goal = list(task.objects.values()), task.success
    if len(things) == 1 and len(goal) == 1 and isinstance(goal[0], ArticulatedOpen | ArticulatedClosed):
        return things[0].asset_class, isinstance(goal[0], ArticulatedOpen)
    return None, False


def rephrased(tasks: Sequence[TaskSpec]) -> list[dict[str, str]]:
    """Ways to say the sentences of tasks in other words, each by the task's sentence; two where all of them have two.

    Raises:
        InputError: the package has no other words for one of the sentences.
    """
    known = read_yaml(SENTENCES)
    for task in tasks:
        if task.description not in known:
            message = f"the package has no other words for {task.description!r}"
            remedy = "sentences: false, or arms of the package's tasks"
            raise InputError(message, field=f"sentences.{task.name}", remedy=remedy)
    count = min(len(known[task.description]) for task in tasks)
    return [{task.description: known[task.description][number] for task in tasks} for number in range(count)]

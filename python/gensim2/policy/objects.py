"""Objects that a policy is taught on, and those that it is measured on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gensim2.errors import InputError
from gensim2.rollout.inputs import TaskInput, has_instances


def unseen_instances(given: Sequence[TaskInput]) -> str:
    """The word for objects that no training on ``train`` saw: ``test`` where all classes have it, else ``new``.

    Raises:
        InputError: some class has neither.
    """
    for word in ("test", "new"):
        found = [
            has_instances(one.library, thing.asset_class, word) for one in given for thing in one.spec.objects.values()
        ]
        if all(found):
            return word
    raise InputError(
        "some class has neither a test split nor new objects",
        field="test_instances",
        remedy="say which: --test-instances all|ID",
    )


def words(group: Sequence[TaskInput], tasks: str | Sequence[str]) -> list[str]:
    """The words that a user gave for tasks: names, or folders."""
    given = (tasks,) if isinstance(tasks, str) else tuple(tasks)
    folders = {Path(word).name: word for word in given if Path(word).is_dir()}
    return [folders.get(one.spec.name, one.spec.name) for one in group]

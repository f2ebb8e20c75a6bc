"""Choose the objects on which a policy is evaluated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Unpack

from gensim2.core.errors import InputError
from gensim2.rollout.config import RolloutArguments
from gensim2.rollout.inputs import TaskInput, has_instances, read_all_task_inputs, taken


def unseen_instances(given: Sequence[TaskInput]) -> str:
    """Return the name of a set of objects that training on the given tasks did not use.

    It tries ``test`` (``test-N`` after training on ``train-N``), then, if a class has no such objects, ``new``.

    Raises:
        InputError: neither set has objects of all classes.
    """
    others = (one.instances.replace("train", "test") for one in given if one.instances.startswith("train-"))
    for word in dict.fromkeys(("test", *others, "new")):
        found = [
            has_instances(one.library, thing.asset_class, word) for one in given for thing in one.spec.objects.values()
        ]
        if all(found) and not shared_objects(given, word):
            return word
    raise InputError(
        "no objects are left for evaluation, because training uses all objects of at least one class",
        field="test_instances",
        remedy="select the evaluation objects with --test-instances all, or with the id of an object",
    )


def check_test_instances(tasks: Sequence[str], seed: int, **given: Unpack[RolloutArguments]) -> None:
    """Check that tasks can be run with the evaluation objects.

    Args:
        tasks: names or folders of the tasks.
        given: scene and rollout arguments; ``instances`` is the name of the set of evaluation objects.

    Raises:
        InputError: a task cannot be run with these objects.
    """
    for task in tasks:
        try:
            read_all_task_inputs([task], seed=seed, **given)
        except InputError as error:
            told = error.message if task in error.message else f"{task}: {error.message}"
            remedy = "say other ones with --test-instances, or leave the task out"
            raise InputError(told, file=error.file, field="test_instances", remedy=remedy) from error


def shared_objects(given: Sequence[TaskInput], word: str) -> list[str]:
    """Return the articulated training objects (``class/id``) that are also in the object set named ``word``.

    Raises:
        InputError: a class has no objects in the set.
    """
    found = []
    for one in given:
        mine, others = (taken(one.spec, one.library, each) for each in (one.instances, word))
        for name, thing in one.spec.objects.items():
            # A class of rigid objects has only one instance, so there is nothing to select.
            if one.library.kind(thing.asset_class) == "articulated":
                found += [f"{thing.asset_class}/{each}" for each in others[name] if each in mine[name]]
    return list(dict.fromkeys(found))


def words(given: Sequence[TaskInput], tasks: str | Sequence[str]) -> dict[str, str]:
    """Return a mapping from the name of each task to the user's argument for it, which is a name or a folder."""
    named = (tasks,) if isinstance(tasks, str) else tuple(tasks)
    return dict(zip((one.spec.name for one in given), named, strict=True))

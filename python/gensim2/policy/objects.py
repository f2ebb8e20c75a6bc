"""Objects that a policy is taught on, and those that it is measured on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from gensim2.errors import InputError
from gensim2.objects.library.catalogue import BUILTIN
from gensim2.rollout.inputs import TaskInput, has_instances
from gensim2.seeding import rng


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


def with_objects(given: TaskInput, count: int, seed: int) -> TaskInput:
    """A task whose scenes draw from ``count`` generated objects of its class, none of them listed or ``new``.

    Raises:
        InputError: the objects are a folder's, or the task has several articulated ones.
    """
    classes = {thing.asset_class for thing in given.spec.objects.values()}
    drawn = [each for each in classes if given.library.kind(each) == "articulated"]
    if given.scene.assets != BUILTIN or len(drawn) != 1 or len(classes) != 1:
        message = f"{given.spec.name}: can be counted for one articulated class of generated objects"
        raise InputError(message, field="objects")
    new = set(given.library.choose(drawn[0], "new"))
    ids = tuple(each for each in given.library.sample(drawn[0], count + len(new), seed) if each not in new)
    # Sorted by number: taking the first would take small numbers.
    order = rng(seed, f"objects/{drawn[0]}").permutation(len(ids))[:count]
    chosen = tuple(ids[number] for number in sorted(order))
    scene = given.scene.options.with_task(given.spec, chosen)
    return replace(given, scene=scene, instances=f"{count} generated, seed {seed}")


def words(group: Sequence[TaskInput], tasks: str | Sequence[str]) -> list[str]:
    """The words that a user gave for tasks: names, or folders."""
    given = (tasks,) if isinstance(tasks, str) else tuple(tasks)
    folders = {Path(word).name: word for word in given if Path(word).is_dir()}
    return [folders.get(one.spec.name, one.spec.name) for one in group]

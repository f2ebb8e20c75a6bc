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


def can_be_counted(given: TaskInput) -> bool:
    """Whether a task has articulated objects that are generated, so that there are as many as are wanted."""
    return given.scene.assets == BUILTIN and bool(_articulated(given))


def with_objects(given: TaskInput, count: int, seed: int) -> TaskInput:
    """A task whose scenes draw from ``count`` generated objects of each articulated class, none listed or ``new``.

    Raises:
        InputError: the objects are a folder's, or the task has no articulated one.
    """
    if not can_be_counted(given):
        raise InputError(f"{given.spec.name}: can be counted for generated articulated objects", field="objects")
    chosen = frozenset((name, _drawn(given, kind, count, seed)) for name, kind in _articulated(given).items())
    scene = given.scene.options.with_task(given.spec, chosen)
    return replace(given, scene=scene, instances=f"{count} generated, seed {seed}")


def _articulated(given: TaskInput) -> dict[str, str]:
    """Classes of a task's objects with a joint, by name."""
    classes = {name: thing.asset_class for name, thing in given.spec.objects.items()}
    return {name: each for name, each in classes.items() if given.library.kind(each) == "articulated"}


def _drawn(given: TaskInput, asset_class: str, count: int, seed: int) -> tuple[str, ...]:
    new = set(given.library.choose(asset_class, "new"))
    ids = tuple(each for each in given.library.sample(asset_class, count + len(new), seed) if each not in new)
    # Sorted by number: taking the first would take small numbers.
    order = rng(seed, f"objects/{asset_class}").permutation(len(ids))[:count]
    return tuple(ids[number] for number in sorted(order))


def words(group: Sequence[TaskInput], tasks: str | Sequence[str]) -> list[str]:
    """The words that a user gave for tasks: names, or folders."""
    given = (tasks,) if isinstance(tasks, str) else tuple(tasks)
    folders = {Path(word).name: word for word in given if Path(word).is_dir()}
    return [folders.get(one.spec.name, one.spec.name) for one in group]

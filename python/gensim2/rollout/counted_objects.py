"""Select any number of generated objects of each class for a task, instead of the objects that its library lists."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gensim2.core.errors import InputError
from gensim2.core.seeding import rng
from gensim2.objects.generators.generate import blueprint, blueprint_hash
from gensim2.objects.library.catalogue import BUILTIN
from gensim2.rollout.inputs import TaskInput

_COUNTED = " generated, seed "
HASHED = 8
"""Number of objects of each class that are hashed to detect changes of the generator."""


def can_be_counted(given: TaskInput) -> bool:
    """Return whether a task has articulated objects from the generator, which can create any number of objects."""
    return given.scene.assets == BUILTIN and bool(_articulated(given))


def with_objects(given: TaskInput, count: int, seed: int) -> TaskInput:
    """Return a task whose scenes use ``count`` generated objects of each articulated class.

    The seed selects the objects. Objects that the library lists are not used.

    Raises:
        InputError: the objects are from a folder, or the task has no articulated object.
    """
    if not can_be_counted(given):
        wrong = f"needs generated articulated objects, but the task {given.spec.name} has none"
        raise InputError(wrong, field="objects")
    chosen = frozenset((name, _drawn(given, kind, count, seed)) for name, kind in _articulated(given).items())
    scene = given.scene.options.with_task(given.spec, chosen)
    return replace(given, scene=scene, instances=f"{count}{_COUNTED}{seed}")


def all_with_objects(given: Sequence[TaskInput], count: int, seed: int) -> list[TaskInput]:
    """Apply :func:`with_objects` to every task with an articulated object; other tasks are returned unchanged.

    Raises:
        InputError: no task has an articulated object.
    """
    if not any(map(can_be_counted, given)):
        message = "none of these tasks has generated articulated objects, which alone can be counted"
        raise InputError(message, field="objects", remedy="leave it out")
    return [with_objects(one, count, seed) if can_be_counted(one) else one for one in given]


def number_of_objects(given: TaskInput) -> int:
    """Return the number of different objects in the scenes. Only articulated objects count if the task has any."""
    chosen = given.scene.instances
    classes = _articulated(given) or {name: thing.asset_class for name, thing in given.spec.objects.items()}
    drawn = dict(chosen) if isinstance(chosen, frozenset) else dict.fromkeys(classes, chosen)
    found = set[tuple[str, str]]()
    for name, asset_class in classes.items():
        word = drawn.get(name, "all")
        ids = given.library.choose(asset_class, word) if isinstance(word, str) else word
        found |= {(asset_class, each) for each in ids}
    return len(found)


def is_counted(instances: str) -> bool:
    """Return whether a task's object selection ``instances`` was made by :func:`with_objects`."""
    return _COUNTED in instances


def hashes(given: TaskInput) -> list[str]:
    """Return hashes of a few generated objects of each class. The list is empty for a task without generated objects.

    A resumed run compares the hashes. A difference shows that a generator has changed.
    """
    chosen = given.scene.instances
    if not is_counted(given.instances) or not isinstance(chosen, frozenset):
        return []
    kinds, ids = _articulated(given), dict(chosen)
    some = [(kinds[name], int(number)) for name in sorted(ids) for number in ids[name][:HASHED]]
    return [blueprint_hash(kind, number, blueprint(kind, number)) for kind, number in some]


def _articulated(given: TaskInput) -> dict[str, str]:
    """Return the classes of a task's articulated objects by name."""
    classes = {name: thing.asset_class for name, thing in given.spec.objects.items()}
    return {name: each for name, each in classes.items() if given.library.kind(each) == "articulated"}


def _drawn(given: TaskInput, asset_class: str, count: int, seed: int) -> tuple[str, ...]:
    new = set(given.library.choose(asset_class, "new"))
    ids = tuple(each for each in given.library.sample(asset_class, count + len(new), seed) if each not in new)
    # The ids are in ascending order, so the first ``count`` ids would all be small. Therefore choose at random.
    order = rng(seed, f"objects/{asset_class}").permutation(len(ids))[:count]
    return tuple(ids[number] for number in sorted(order))

"""Generated objects in any number: scenes that draw from so many of each class, of which a library lists none."""

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
"""Objects of each class by which it is told whether the generator makes the same."""


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
    return replace(given, scene=scene, instances=f"{count}{_COUNTED}{seed}")


def all_with_objects(given: Sequence[TaskInput], count: int, seed: int) -> list[TaskInput]:
    """As :func:`with_objects` for every task that has such objects; others, of rigid ones alone, as they are.

    Raises:
        InputError: none has.
    """
    if not any(map(can_be_counted, given)):
        message = "none of these tasks has generated articulated objects, which alone can be counted"
        raise InputError(message, field="objects", remedy="leave it out")
    return [with_objects(one, count, seed) if can_be_counted(one) else one for one in given]


def number_of_objects(given: TaskInput) -> int:
    """Number of different objects that the scenes of a task draw from, of those with a joint where it has some."""
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
    """Whether :func:`with_objects` chose a task's objects, from its word for them."""
    return _COUNTED in instances


def hashes(given: TaskInput) -> list[str]:
    """Hashes of some of the objects that :func:`with_objects` chose, which change with what the generator makes.

    Args:
        given: a task; of one whose objects are listed there are none.
    """
    chosen = given.scene.instances
    if not is_counted(given.instances) or not isinstance(chosen, frozenset):
        return []
    kinds, ids = _articulated(given), dict(chosen)
    some = [(kinds[name], int(number)) for name in sorted(ids) for number in ids[name][:HASHED]]
    return [blueprint_hash(kind, number, blueprint(kind, number)) for kind, number in some]


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

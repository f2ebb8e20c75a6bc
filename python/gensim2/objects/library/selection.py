"""Resolve selections of objects (``drawer``, ``drawer/test``, ``drawer/3``) and values of ``--instances``."""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Mapping, Sequence

from gensim2.core.errors import InputError, near
from gensim2.objects.library.catalogue import SETS, Library
from gensim2.objects.types import Kind

Item = tuple[str, str]


def select(
    library: Library,
    words: Sequence[str],
    *,
    every: bool = False,
    drawn: int = 0,
    seed: int = 0,
    kind: Kind | None = None,
) -> list[Item]:
    """Return the selected (class, id) pairs without repetition, in the order of the selections.

    Args:
        words: ``CLASS`` or ``CLASS/WHICH``. ``WHICH`` is an id, ``train``, ``test``, ``new``, ``all`` or ``random``.
        every: whether to add all objects of the library's own classes. Default: only if neither ``words`` nor ``drawn``
            is given.
        drawn: number of random objects to add from each class in ``words``, or from every class. For a generated class
            these are new objects, and for a folder any objects.
        seed: seed of ``random`` and ``drawn``.
        kind: kind of the selected objects; None: both kinds.

    Raises:
        InputError: a class or instance is unknown or of the other kind, or a class is too small for a test split.
    """
    items: dict[Item, None] = {}
    if every or not (words or drawn):
        words = [*words, *library.own_classes(kind)]
    for word in words:
        asset_class, slash, which = word.partition("/")
        if slash and not which:
            raise InputError(f"{word!r} names no instance", field="object", remedy="write CLASS or CLASS/ID")
        if kind is not None:
            library.check_kind(asset_class, kind)
        for instance_id in library.choose(asset_class, which or "all", seed):
            items[asset_class, instance_id] = None
    if drawn:
        named = dict.fromkeys(word.partition("/")[0] for word in words)
        for asset_class in named or library.own_classes(kind):
            for instance_id in library.sample(asset_class, drawn, seed):
                items[asset_class, instance_id] = None
    return list(items)


def select_one(library: Library, word: str, *, seed: int = 0) -> Item:
    """Return class and id of the first object of ``word``, such as ``"drawer"``, ``"drawer/3"`` or ``"drawer/test"``.

    Raises:
        InputError: as for :func:`select`.
    """
    return select(library, [word], seed=seed)[0]


def words_of_objects(
    instances: Callable[[str], Sequence[str]], classes: Mapping[str, str], words: Sequence[str]
) -> dict[str, Sequence[str]]:
    """Return the values of the option ``--instances`` that apply to each object of a task, by the object's name.

    If all values are sets (``all``, ``train``, ``test``, ``new``), they apply to every object. If any value is an id,
    all values apply only to the object of :func:`object_of_ids`, and the other objects get ``all``.

    Args:
        instances: function that lists the ids of a class.
        classes: class of each object, by name.
        words: values of ``--instances``.
    """
    if all(word in SETS for word in words):
        return dict.fromkeys(classes, words)
    chosen = object_of_ids(instances, classes)
    return {name: words if name == chosen else ("all",) for name in classes}


def object_of_ids(instances: Callable[[str], Sequence[str]], classes: Mapping[str, str]) -> str:
    """Return the object that ids in ``--instances`` select.

    This object is the first one whose class has several instances, else the first object.
    """
    return next((name for name, each in classes.items() if len(instances(each)) > 1), next(iter(classes)))


def taken_instances(
    choose: Callable[[str, str], Sequence[str]], asset_class: str, asked: Sequence[str], own: Sequence[str] | None
) -> tuple[str, ...]:
    """Return the ids that both the user's option ``--instances`` and the task's spec allow.

    Args:
        choose: function that returns the ids for a class and one value.
        asked: values that the user gave to ``--instances``.
        own: values in the task's spec; None: the task accepts all ids.

    Raises:
        InputError: an instance or split does not exist, or the task accepts none of the selected ids.
    """
    wanted = tuple(dict.fromkeys(i for word in asked for i in choose(asset_class, word)))
    if own is None:
        return wanted
    takes = dict.fromkeys(i for word in own for i in choose(asset_class, word))
    found = tuple(i for i in wanted if i in takes)
    if not found:
        raise InputError(
            f"the task accepts only the instances {', '.join(takes)} of {asset_class}, but none of these "
            f"instances is in the selection {', '.join(asked)}",
            field="instances",
        )
    return found


def wanted_classes(
    libraries: Sequence[Library], classes: Sequence[str] | None
) -> list[tuple[Library, tuple[str, ...]]]:
    """Return each library with its names in ``classes``. None stands for all classes that the library itself has.

    Raises:
        InputError: no library has a class of this name.
    """
    if classes is None:
        return [(library, library.own_classes()) for library in libraries]
    known = sorted({name for library in libraries for name in library.classes()})
    for name in classes:
        if name not in known:
            raise InputError(f"no class {reprlib.repr(name)}", field="--classes", remedy=near(name, known))
    chosen = [(library, tuple(name for name in library.classes() if name in classes)) for library in libraries]
    return [(library, names) for library, names in chosen if names]

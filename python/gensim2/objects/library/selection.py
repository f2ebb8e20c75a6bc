"""Which objects a person means: words like ``drawer``, ``drawer/test`` or ``drawer/3``, and ``--instances``."""

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
    """(class, id) pairs, each once, in the order in which they were named.

    Args:
        words: ``CLASS`` (all its instances) or ``CLASS/WHICH`` with an id, ``train``, ``test``, ``new``, ``all`` or
            ``random``.
        every: all that the library itself has, or of one ``kind``. It is also what no word at all means, unless
            ``drawn`` asks for something.
        drawn: this many more of each class, or of each class that is named: new numbers where objects are generated,
            else any of the folder's.
        seed: of ``random`` and ``drawn``.
        kind: of all; None: both.

    Raises:
        InputError: no such class or instance, one of the other kind, or a class too small for a test split.
    """
    items: dict[Item, None] = {}
    if every or not (words or drawn):
        words = [*words, *library.own_classes(kind)]
    for word in words:
        asset_class, slash, which = word.partition("/")
        if slash and not which:
            raise InputError(f"no instance in {word!r}", field="object", remedy="write CLASS or CLASS/ID")
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
    """The (class, id) of ``CLASS/WHICH``, of which the first counts, or the first of ``CLASS``.

    Raises:
        InputError: as for :func:`select`.
    """
    return select(library, [word], seed=seed)[0]


def words_of_objects(
    instances: Callable[[str], Sequence[str]], classes: Mapping[str, str], words: Sequence[str]
) -> dict[str, Sequence[str]]:
    """Resolve ``--instances`` for each object of a task.

    Words that stand for a set (``all``, ``train``, ``test``, ``new``) are said of every object, ids of one
    (:func:`object_of_ids`), and the others may be any.

    Args:
        instances: lists the ids of a class.
        classes: of the objects, by name.
        words: as given.
    """
    if all(word in SETS for word in words):
        return dict.fromkeys(classes, words)
    chosen = object_of_ids(instances, classes)
    return {name: words if name == chosen else ("all",) for name in classes}


def object_of_ids(instances: Callable[[str], Sequence[str]], classes: Mapping[str, str]) -> str:
    """Name of the object that an id is said of: the first of whose class there are several, or the first."""
    return next((name for name, each in classes.items() if len(instances(each)) > 1), next(iter(classes)))


def taken_instances(
    choose: Callable[[str, str], Sequence[str]], asset_class: str, asked: Sequence[str], own: Sequence[str] | None
) -> tuple[str, ...]:
    """Ids of a class that words stand for, each once; of those that a task takes, where it says which.

    Args:
        choose: what one word stands for, by class and word.
        asset_class: name of the class.
        asked: words of the caller.
        own: words of the task; None: it takes all.

    Raises:
        InputError: no such instance or split, or none that the task takes.
    """
    wanted = tuple(dict.fromkeys(i for word in asked for i in choose(asset_class, word)))
    if own is None:
        return wanted
    takes = dict.fromkeys(i for word in own for i in choose(asset_class, word))
    found = tuple(i for i in wanted if i in takes)
    if not found:
        raise InputError(
            f"the task takes {', '.join(takes)} of {asset_class}, none of which is in {', '.join(asked)}",
            field="instances",
        )
    return found


def wanted_classes(
    libraries: Sequence[Library], classes: Sequence[str] | None
) -> list[tuple[Library, tuple[str, ...]]]:
    """Each library with those of its classes that are named, its own where ``classes`` is None; none without any.

    Raises:
        InputError: no library has a class of such a name.
    """
    if classes is None:
        return [(library, library.own_classes()) for library in libraries]
    known = sorted({name for library in libraries for name in library.classes()})
    for name in classes:
        if name not in known:
            raise InputError(f"no class {reprlib.repr(name)}", field="--classes", remedy=near(name, known))
    chosen = [(library, tuple(name for name in library.classes() if name in classes)) for library in libraries]
    return [(library, names) for library, names in chosen if names]

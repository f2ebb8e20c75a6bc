"""Separate the object instances that a search may use from the instances that test its result."""

from __future__ import annotations

from dataclasses import dataclass

from gensim2.data.records import Instances
from gensim2.objects import Library
from gensim2.objects.library.catalogue import SMALLEST_TO_SPLIT
from gensim2.scenes.config import Drawn
from gensim2.tasks.spec import TaskSpec


@dataclass(frozen=True)
class Apart:
    """Division of the instances of a task's articulated objects into instances that the search for strategies uses and
    instances that test the result of the search.

    Attributes:
        library: object library.
        classes: class of each articulated object, by the object's name in the task. Rigid classes have a single
            instance each and are left out.
        kind: set of the instances that test the result. The set ``"new"`` contains new objects of generated classes,
            and ``"test"`` is the test split of classes of real objects. The set ``"all"`` contains all instances; it is
            used if a class has too few instances for a test split.
        search: instances that the search uses, as a value of ``--instances``.
    """

    library: Library
    classes: dict[str, str]
    kind: Instances
    search: str

    def verification(self, episodes: int, seed: int) -> list[Drawn]:
        """Return, for each verification episode, the instances from which the episode takes its objects.

        If ``kind`` is ``"new"``, the entry of an episode contains the id of a new object for each articulated object of
        the task. Otherwise the entry is the name of the set, ``kind``.
        """
        if self.kind != "new":
            return [self.kind] * episodes
        drawn = {name: self.library.sample(each, episodes, seed) for name, each in self.classes.items()}
        return [frozenset((name, ids[index]) for name, ids in drawn.items()) for index in range(episodes)]


def kept_apart(library: Library, task: TaskSpec) -> Apart:
    """Divide the instances of a task's articulated objects; rigid classes have one instance each and are not divided.

    Raises:
        InputError: a class is unknown.
    """
    classes = {
        name: thing.asset_class
        for name, thing in task.objects.items()
        if library.kind(thing.asset_class) == "articulated"
    }
    if classes and all(library.source(each) == "generated" for each in classes.values()):
        return Apart(library, classes, "new", "train")
    if classes and all(len(library.instances(each)) >= SMALLEST_TO_SPLIT for each in classes.values()):
        return Apart(library, classes, "test", "train")
    return Apart(library, classes, "all", "all")


def seen_by_search(library: Library, asset_class: str) -> tuple[str, ...]:
    """Return the instance ids of a class that designers and searches may use.

    Raises:
        InputError: the class is unknown.
    """
    split = library.source(asset_class) == "generated" or len(library.instances(asset_class)) >= SMALLEST_TO_SPLIT
    return library.choose(asset_class, "train" if split else "all")

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
    """Division of a task's articulated instances into instances for the search and instances for its test.

    Attributes:
        classes: articulated classes by name of the object. A rigid class has only one instance.
        kind: instances of the test. ``"new"``: new generated objects; ``"test"``: the test split of real classes;
            ``"all"``: all instances, if a class has too few for a test split.
        search: instances that the search uses, as a value of ``--instances``.
    """

    library: Library
    classes: dict[str, str]
    kind: Instances
    search: str

    def verification(self, episodes: int, seed: int) -> list[Drawn]:
        """Return, for each verification episode, the instances from which the episode takes its objects.

        For ``"new"``, an entry has a new id for each articulated object. Otherwise it is ``kind``.
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

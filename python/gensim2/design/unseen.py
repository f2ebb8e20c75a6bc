"""Which instances a search may see, and which are kept for the test of what it found."""

from __future__ import annotations

from dataclasses import dataclass

from gensim2.data.records import Instances
from gensim2.objects import Library
from gensim2.objects.library.catalogue import SMALLEST_TO_SPLIT
from gensim2.scenes.config import Drawn
from gensim2.tasks.spec import TaskSpec


@dataclass(frozen=True)
class Apart:
    """The instances of a task's objects, divided.

    Attributes:
        library: of the objects.
        classes: class of each object that has a joint, by its name in the task; of a rigid one there is one instance.
        kind: of those that a verification draws from: ``"new"`` are numbers beyond the listed ones of generated
            classes, ``"test"`` is the test split of a folder, ``"all"`` says that a class has too few to keep some
            apart.
        search: word for those that a search draws from.
    """

    library: Library
    classes: dict[str, str]
    kind: Instances
    search: str

    def verification(self, episodes: int, seed: int) -> list[Drawn]:
        """Return what each episode of a verification draws from: new objects each, or the word for the others."""
        if self.kind != "new":
            return [self.kind] * episodes
        drawn = {name: self.library.sample(each, episodes, seed) for name, each in self.classes.items()}
        return [frozenset((name, ids[index]) for name, ids in drawn.items()) for index in range(episodes)]


def kept_apart(library: Library, task: TaskSpec) -> Apart:
    """Divide the instances of a task's objects; rigid ones are what they are, in other poses.

    Raises:
        InputError: there is no such class.
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
    """Ids of a class that a designer may be told of.

    Raises:
        InputError: there is no such class.
    """
    split = library.source(asset_class) == "generated" or len(library.instances(asset_class)) >= SMALLEST_TO_SPLIT
    return library.choose(asset_class, "train" if split else "all")

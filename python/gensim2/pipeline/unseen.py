"""Which instances a search may see, and which are kept for the test of what it found."""

from __future__ import annotations

from dataclasses import dataclass

from gensim2.objects import Library
from gensim2.objects.library.catalogue import SMALLEST_TO_SPLIT
from gensim2.pipeline.records import Instances


@dataclass(frozen=True)
class Apart:
    """The instances of one class, divided.

    Attributes:
        kind: of those that a verification draws from: ``"new"`` are numbers beyond the listed ones of a generated
            class, ``"test"`` is the test split of a folder, ``"all"`` says that the class has too few to keep some
            apart.
        search: word for those that a search draws from.
    """

    library: Library
    asset_class: str
    kind: Instances
    search: str

    def verification(self, episodes: int, seed: int) -> list[str]:
        """Return what each episode of a verification draws from: a new object each, or the word for the others."""
        if self.kind == "new":
            return list(self.library.sample(self.asset_class, episodes, seed))
        return [self.kind] * episodes


def kept_apart(library: Library, asset_class: str) -> Apart:
    """Divide the instances of a class.

    Raises:
        InputError: there is no such class.
    """
    if library.kind(asset_class) == "articulated" and library.source(asset_class) == "generated":
        return Apart(library, asset_class, "new", "train")
    if len(library.instances(asset_class)) >= SMALLEST_TO_SPLIT:
        return Apart(library, asset_class, "test", "train")
    return Apart(library, asset_class, "all", "all")

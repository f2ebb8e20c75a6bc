"""Check that the objects of a data set's episodes have not changed."""

from __future__ import annotations

from pathlib import Path

from gensim2.core.errors import InputError
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.data.dataset import DATASET_JSON, DataSet
from gensim2.objects import open_library
from gensim2.rollout.identity import versions
from gensim2.rollout.record import Episode

_REMEDY = "restore the object, or give its folder with --assets"


class ObjectCheck:
    """Checks that the objects have not changed since the episodes of a data set were run.

    Objects are compared by a hash of their files and the version of gensim2. A difference is an error if the installed
    version made the data set. Otherwise it gives a message, once for each object.

    Args:
        dataset: data set of the episodes.
        progress: listener for messages.

    Attributes:
        library: library of the objects.

    Raises:
        InputError: the folder of objects does not exist.
    """

    def __init__(self, dataset: DataSet, progress: Progress = NULL_PROGRESS) -> None:
        self._assets, self._progress = dataset.scene.assets, progress
        self.library = open_library(self._assets)
        self._dataset, self._version = dataset, dataset.record.versions.get("gensim2")
        self._contents: dict[tuple[str, str], str] = {}
        self._said: set[tuple[str, str]] = set()

    def episode(self, row: Episode, file: Path) -> None:
        """Check the objects of an episode that was read from ``file``.

        Raises:
            InputError: an object is missing or has changed.
        """
        for thing in row.objects.values():
            self._one((thing.asset_class, thing.id), thing.content_hash, file)

    def all(self) -> None:
        """Check all objects of the data set.

        Raises:
            InputError: an object is missing or has changed.
        """
        for name, used in self._dataset.record.objects.items():
            asset_class, _, instance = name.partition("/")
            self._one((asset_class, instance), used.content_hash, self._dataset.path / DATASET_JSON)

    def _one(self, key: tuple[str, str], content_hash: str, file: Path) -> None:
        if key not in self._contents:
            try:
                self._contents[key] = self.library.load(*key).content_hash
            except InputError as error:
                wrong = f"the object {'/'.join(key)} of this run cannot be loaded: {error.message}"
                raise InputError(wrong, file=file, remedy=_REMEDY) from error
        if self._contents[key] == content_hash or key in self._said:
            return
        if self._version == versions(self._dataset.record.scene.engine)["gensim2"]:
            message = (
                f"the episode was recorded with a different version of {'/'.join(key)} from the one in {self._assets}"
            )
            raise InputError(message, file=file, remedy=_REMEDY)
        self._said.add(key)
        self._progress.message(f"{'/'.join(key)} differs from what gensim2 {self._version} prepared")

"""The native data set: one file for each episode, one folder for each task (docs/reference/data_format.md).

dataset = DataSet.open(Path("runs/night"))
for row in dataset.task("OpenBox").rows():          # every episode, by index
    if row.held:
        stored = dataset.task("OpenBox").read(row)  # its states and actions
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path

from gensim2.core.errors import InputError, near
from gensim2.core.files import write_json
from gensim2.core.foreign.tree import ForeignTree
from gensim2.core.record_files import read_record
from gensim2.data.frame_access import FrameAccess
from gensim2.data.observation_file import read_description, spec_of_file
from gensim2.data.record import DatasetRecord
from gensim2.data.store import OBSERVATIONS, TaskStore
from gensim2.objects import open_library
from gensim2.objects.library.catalogue import BUILTIN
from gensim2.perception import ObservationSpec
from gensim2.scenes.config import SceneOptions

DATASET_JSON = "dataset.json"


class DataSet:
    """A data set on disk, opened by :meth:`open`.

    Example:
        ```python
        data = gensim2.DataSet.open("night")
        frames = data.frames()  # frames[i] is one frame; frames.torch() is a torch.utils.data.Dataset
        ```

    Args:
        path: folder of the data set.
        record: contents of the folder's ``dataset.json``.
        assets: current folder of the object library; None: the folder recorded in the data set.
    """

    def __init__(self, path: Path, record: DatasetRecord, assets: str | None = None) -> None:
        self.path, self.record, self._assets = path, record, assets

    @staticmethod
    def open(path: Path | str, assets: Path | str | None = None) -> DataSet:
        """Open a data set, even if its collection is unfinished.

        Args:
            path: folder of the data set.
            assets: current folder of the objects. None: the recorded folder. Data sets of built-in objects need no
                folder. Objects are checked on first use (:mod:`gensim2.data.used_objects`).

        Raises:
            InputError: ``dataset.json`` is missing, damaged or of another version, or ``assets`` has no objects.
        """
        path = Path(path)
        file = path / DATASET_JSON
        record = read_record(file, DatasetRecord, "restore the file, or choose the folder of a data set")
        location = None if assets is None else str(open_library(assets).location)
        return DataSet(path, record, None if record.scene.assets == BUILTIN else location)

    @property
    def assets(self) -> str:
        """Folder of the objects, or ``"builtin"`` for generated objects. The folder may no longer exist."""
        return self.record.scene.assets if self._assets is None else self._assets

    @cached_property
    def scene(self) -> SceneOptions:
        """Return the scene options that all tasks share. Their ``assets`` is the current folder of the objects.

        Raises:
            InputError: the folder of objects does not exist.
        """
        if self._assets is None and self.assets != BUILTIN and not Path(self.assets).is_dir():
            raise InputError(
                f"the object folder {self.assets} does not exist",
                file=self.path / DATASET_JSON,
                field="arguments.assets",
                remedy="give the current location of the folder with --assets",
            )
        return replace(self.record.scene, assets=self.assets)

    def save(self) -> None:
        write_json(self.path / DATASET_JSON, self.record.model_dump())

    def frames(self, tasks: Sequence[str] = (), *, observations: bool | None = None, horizon: int = 1) -> FrameAccess:
        """Return all frames for random access; ``.torch()`` turns them into a ``torch.utils.data.Dataset``.

        Args:
            tasks: names of the tasks; empty for all.
            observations, horizon: as for :class:`~gensim2.data.frame_access.FrameAccess`.

        Raises:
            InputError: as for :class:`~gensim2.data.frame_access.FrameAccess`.
        """
        stores = [self.task(name) for name in tasks or self.tasks]
        return FrameAccess(stores, self.record.scene.robot, observations=observations, horizon=horizon)

    def observation_spec(self) -> ObservationSpec:
        """Return the observation spec with which the data set was rendered.

        Raises:
            InputError: the data set was not rendered, or an observation file is damaged.
        """
        for name in self.tasks:
            first = min((self.path / name / OBSERVATIONS).glob("*.h5"), default=None)
            if first is not None:
                return spec_of_file(read_description(first), first)
        raise InputError("has no observations", file=self.path, remedy="run `gensim2 render` on it")

    @property
    def tasks(self) -> tuple[str, ...]:
        return tuple(self.record.tasks)

    def task(self, name: str) -> TaskStore:
        """Return the store of a task's episodes.

        Raises:
            InputError: the data set has no such task.
        """
        if name not in self.record.tasks:
            raise InputError(f"has no task {name!r}", file=self.path / DATASET_JSON, remedy=near(name, self.tasks))
        return TaskStore(ForeignTree(self.path).inside(name))

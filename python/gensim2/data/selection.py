"""Select the successful episodes of a data set that meet given quality requirements."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from gensim2.core.errors import InputError
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.data.dataset import DataSet
from gensim2.data.store import TaskStore
from gensim2.data.used_objects import ObjectCheck
from gensim2.robots import robot
from gensim2.rollout.record import Episode
from gensim2.scenes.physics import physics_switches


@dataclass(frozen=True)
class Selection:
    """Filter of successful episodes.

    Attributes:
        tasks: names of the tasks; empty for all.
        strict: require the verdict `strict`.
        whole: require that every planned motion was executed completely.
        first_try: require that no step was replanned.
        shortest, longest: minimum and maximum number of control steps.
        clearance: minimum clearance (:mod:`gensim2.data.clearance`), m; None: no minimum.
    """

    tasks: tuple[str, ...] = ()
    strict: bool = False
    whole: bool = False
    first_try: bool = False
    shortest: int = 0
    longest: int | None = None
    clearance: float | None = None

    def __post_init__(self) -> None:
        if self.clearance is not None:
            from gensim2.data.clearance import FARTHEST

            if not self.clearance <= FARTHEST:
                raise InputError(f"must be at most {FARTHEST} m, but is {self.clearance}", field="min_clearance")

    def takes(self, row: Episode) -> bool:
        """Return whether an episode's record passes the filter."""
        return (
            row.held
            and (row.strict or not self.strict)
            and not (self.whole and row.partial)
            and not (self.first_try and row.replans)
            and self.shortest <= row.control_steps
            and (self.longest is None or row.control_steps <= self.longest)
        )

    def of(self, dataset: DataSet, progress: Progress = NULL_PROGRESS) -> Iterator[tuple[TaskStore, list[Episode]]]:
        """Yield each task with its selected episodes by index; tasks without a selected episode are left out.

        Raises:
            InputError: a task is unknown, the collection is incomplete, or a file is damaged, missing or changed.
        """
        for name in dict.fromkeys(self.tasks or dataset.tasks):
            store = dataset.task(name)
            rows = [row for row in store.rows() if self.takes(row)]
            if self.clearance is not None:
                rows = self._clear(dataset, store, rows, self.clearance, progress)
            if rows:
                yield store, rows

    @staticmethod
    def _clear(
        dataset: DataSet, store: TaskStore, rows: list[Episode], least: float, progress: Progress
    ) -> list[Episode]:
        """Return the episodes with a clearance of at least ``least`` metres."""
        from gensim2.data.clearance import ClearanceMeter  # imported here, because it imports SciPy

        scene = dataset.scene
        objects = ObjectCheck(dataset, progress)
        meter = ClearanceMeter(robot(scene.robot), store.spec(), objects.library, physics_switches(scene.physics).hulls)
        progress.start(f"{store.name}: clearance", len(rows))
        kept = []
        for row in rows:
            objects.episode(row, store.path(row.index))
            if meter.of(store.recording(row)).distance >= least:
                kept.append(row)
            progress.advance()
        return kept


def some(
    selection: Selection, dataset: DataSet, progress: Progress = NULL_PROGRESS
) -> list[tuple[TaskStore, list[Episode]]]:
    """Return the tasks and episodes that :meth:`Selection.of` selects. Raise an error if it selects none.

    Raises:
        InputError: no episode is selected.
    """
    found = list(selection.of(dataset, progress))
    if not found:
        raise InputError("no episode matches the selection", file=dataset.path, remedy="remove some of the conditions")
    return found

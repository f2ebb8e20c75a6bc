"""Which episodes of a data set are meant: all that held, or those of them that are good enough."""

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
    """Filter over the episodes that held.

    Attributes:
        tasks: names; none: all.
        strict: the strict verdict, too.
        whole: no step executed a part of a motion.
        first_try: nothing had to be planned again.
        shortest, longest: control steps.
        clearance: least of :mod:`gensim2.data.clearance`, m; None: any.
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
                raise InputError(f"is measured up to {FARTHEST} m, not {self.clearance}", field="min_clearance")

    def takes(self, row: Episode) -> bool:
        """Whether an episode's record lets it be among them."""
        return (
            row.held
            and (row.strict or not self.strict)
            and not (self.whole and row.partial)
            and not (self.first_try and row.replans)
            and self.shortest <= row.control_steps
            and (self.longest is None or row.control_steps <= self.longest)
        )

    def of(self, dataset: DataSet, progress: Progress = NULL_PROGRESS) -> Iterator[tuple[TaskStore, list[Episode]]]:
        """Yield each task with those of its episodes that are taken, by index; a task with none is left out.

        Raises:
            InputError: the data set has no such task, or its collection is not complete, or an episode's file that has
                to be looked at is damaged, or an object of it is not there or another one.
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
        """Those whose clearance is at least ``least``; it does not stand in the record."""
        from gensim2.data.clearance import ClearanceMeter  # here: it brings SciPy

        scene = dataset.scene
        objects = ObjectCheck(dataset, progress)
        meter = ClearanceMeter(robot(scene.robot), store.spec(), objects.library, physics_switches(scene.physics).hulls)
        progress.start(f"{store.name}: clearance", len(rows))
        kept = []
        for row in rows:
            objects.episode(row, store.path(row.index))
            recording = store.read(row).recording
            assert recording is not None  # of what held it always is
            if meter.of(recording).distance >= least:
                kept.append(row)
            progress.advance()
        return kept


def some(
    selection: Selection, dataset: DataSet, progress: Progress = NULL_PROGRESS
) -> list[tuple[TaskStore, list[Episode]]]:
    """As :meth:`Selection.of`, at least one episode.

    Raises:
        InputError: there is none.
    """
    found = list(selection.of(dataset, progress))
    if not found:
        raise InputError("no episode is taken", file=dataset.path, remedy="ask for less")
    return found

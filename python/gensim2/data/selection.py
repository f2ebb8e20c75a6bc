"""Which episodes of a data set are meant: all that held, or those of them that are good enough."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from gensim2.data.store import DataSet, TaskStore
from gensim2.errors import InputError
from gensim2.pipeline.attempts import LoggedEpisode


@dataclass(frozen=True)
class Selection:
    """What an episode must fulfil, beside that it held.

    Attributes:
        tasks: names; none: all.
        strict: the strict verdict, too.
        whole: no step executed a part of a motion.
        first_try: nothing had to be planned again.
        shortest, longest: control steps.
    """

    tasks: tuple[str, ...] = ()
    strict: bool = False
    whole: bool = False
    first_try: bool = False
    shortest: int = 0
    longest: int | None = None

    def takes(self, row: LoggedEpisode) -> bool:
        """Whether an episode is among them."""
        return (
            row.held
            and (row.strict or not self.strict)
            and not (self.whole and row.partial)
            and not (self.first_try and row.replans)
            and self.shortest <= row.control_steps
            and (self.longest is None or row.control_steps <= self.longest)
        )

    def of(self, dataset: DataSet) -> Iterator[tuple[TaskStore, list[LoggedEpisode]]]:
        """Yield each task with those of its episodes that are taken, by index; a task with none is left out.

        Raises:
            InputError: the data set has no such task, or its collection is not complete.
        """
        for name in self.tasks or dataset.tasks:
            store = dataset.task(name)
            if rows := [row for row in store.rows() if self.takes(row)]:
                yield store, rows


def some(selection: Selection, dataset: DataSet) -> list[tuple[TaskStore, list[LoggedEpisode]]]:
    """As :meth:`Selection.of`, at least one episode.

    Raises:
        InputError: there is none.
    """
    found = list(selection.of(dataset))
    if not found:
        raise InputError("no episode is taken", file=dataset.path, remedy="ask for less")
    return found

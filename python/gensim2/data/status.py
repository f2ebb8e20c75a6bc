"""Progress of a collection, as plain values for a display."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from gensim2.core.progress import NullProgress, Progress


@dataclass(frozen=True)
class TaskStatus:
    """One task of a collection.

    Attributes:
        name: of the task.
        total: episodes to try.
        tried, held, strict: so far, in this run and in those before it.
        causes: why the others do not count as held, most frequent first.
    """

    name: str
    total: int
    tried: int
    held: int
    strict: int
    causes: dict[str, int]


@dataclass(frozen=True)
class Status:
    """A collection at one moment.

    Attributes:
        tasks: in order.
        ran: episodes that this run has finished.
        seconds: of wall time that it took for them.
        stored: bytes of all episodes.
        free: bytes that the disk still has.
        failed_tries: tries that came to nothing in this run, because a process died, hung or met a bug.
    """

    tasks: tuple[TaskStatus, ...]
    ran: int
    seconds: float
    stored: int
    free: int
    failed_tries: int

    @property
    def total(self) -> int:
        """Number of episodes to try, of all tasks together."""
        return sum(task.total for task in self.tasks)

    @property
    def tried(self) -> int:
        """Episodes that were tried of all tasks."""
        return sum(task.tried for task in self.tasks)

    @property
    def rate(self) -> float | None:
        """Episodes a second of this run; None before the first."""
        return self.ran / self.seconds if self.ran and self.seconds > 0 else None

    @property
    def left(self) -> float | None:
        """Seconds to the end at this rate; None where it is unknown."""
        return (self.total - self.tried) / self.rate if self.rate else None


class Listener(Progress, Protocol):
    """Watches a collection; of the stages of a :class:`~gensim2.core.progress.Progress` there are none."""

    def update(self, status: Status) -> None:
        """Take note of how far it is; called a few times a second at most."""


class NullListener(NullProgress):
    """Watches and says nothing."""

    def update(self, status: Status) -> None:
        """Ignore it."""

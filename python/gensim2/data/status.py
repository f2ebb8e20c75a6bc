"""Describe the progress of a collection for a display."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from gensim2.rollout.tally import engines_record


@dataclass(frozen=True)
class TaskStatus:
    """Progress of one task.

    Attributes:
        total: number of episodes to run.
        tried: number of finished episodes, including the episodes of earlier calls.
        held: number of successful episodes (verdict `held`) among the finished episodes.
        strict: number of episodes that pass the verdict `strict` among the finished episodes.
        causes: number of failed episodes by cause, most frequent first.
        engines: number of successful episodes by physics engine. Empty unless ``engines="both"``.
        disagreed: seeds of the scenes in which only one engine passes `held`.
    """

    name: str
    total: int
    tried: int
    held: int
    strict: int
    causes: dict[str, int]
    engines: dict[str, int] = field(default_factory=dict)
    disagreed: tuple[int, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON fields. Fields that compare two engines are left out if only one engine is used."""
        told = asdict(self)
        del told["engines"], told["disagreed"]
        return {**told, **engines_record(self.engines, self.disagreed)}


@dataclass(frozen=True)
class Status:
    """State of a collection.

    Attributes:
        tasks: progress of each task, in the order of the command.
        ran: number of episodes finished in this run.
        seconds: wall time of this run, s.
        stored: size of all episodes, bytes.
        free: free disk space, bytes.
        failed_tries: number of attempts that failed because a process died, hung or raised an unexpected exception.
        pace: mean time between finished episodes, s, from the second episode of each worker on. None before.
    """

    tasks: tuple[TaskStatus, ...]
    ran: int
    seconds: float
    stored: int
    free: int
    failed_tries: int
    pace: float | None = None

    @property
    def total(self) -> int:
        """Number of episodes to run in all tasks."""
        return sum(task.total for task in self.tasks)

    @property
    def tried(self) -> int:
        """Number of finished episodes in all tasks."""
        return sum(task.tried for task in self.tasks)

    @property
    def rate(self) -> float | None:
        """Episodes per second in this run; None before the first episode is finished."""
        return self.ran / self.seconds if self.ran and self.seconds > 0 else None

    @property
    def left(self) -> float | None:
        """Estimated remaining time, s; None if unknown."""
        return None if self.pace is None else (self.total - self.tried) * self.pace

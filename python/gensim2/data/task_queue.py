"""The episodes of one task in a collection: which are done, which are to come, and how one is kept."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from gensim2.data.record import DatasetRecord
from gensim2.data.status import TaskStatus
from gensim2.data.store import TaskStore
from gensim2.errors import InputError
from gensim2.processes import Job
from gensim2.rollout.evaluator import PoolEvaluator
from gensim2.rollout.inputs import TaskInput
from gensim2.rollout.record import Episode
from gensim2.rollout.recording import Recording


@dataclass(frozen=True)
class Kept:
    """What a worker says of an episode that it has written down.

    Attributes:
        held, strict, cause: as of the episode.
        size: bytes of its file.
    """

    held: bool
    strict: bool
    cause: str | None
    size: int

    @staticmethod
    def of(episode: Episode, path: Path) -> Kept:
        """What is said of an episode whose file lies at ``path``."""
        cause = None if episode.cause is None else str(episode.cause)
        return Kept(episode.held, episode.strict, cause, path.stat().st_size)


def keep_episode(folder: Path, index: int, failures: bool, episode: Episode, recording: Recording | None) -> Kept:
    """Write an episode into its task's folder; called in the worker that ran it.

    Args:
        failures: keep the states of one that does not hold, too.
    """
    store = TaskStore(folder)
    store.add(index, episode, recording if episode.held or failures else None)
    return Kept.of(episode, store.path(index, episode.held))


class TaskQueue:
    """The episodes of one task.

    Args:
        given: the task.
        store: its folder.
        record: of the data set.

    Attributes:
        done: a byte an episode: 1 where it is finished.
        tried, held, strict, causes: over those, and ``size`` the bytes of their files.
    """

    def __init__(self, given: TaskInput, store: TaskStore, record: DatasetRecord) -> None:
        self.given, self.store, self._record = given, store, record
        self.name, self.total = given.spec.name, record.episodes
        self._forget()

    def _forget(self) -> None:
        self.done = bytearray(self.total)
        self.tried = self.held = self.strict = self.size = 0
        self.causes: Counter[str] = Counter()

    @property
    def is_done(self) -> bool:
        """Whether all were tried."""
        return self.tried == self.total

    @property
    def status(self) -> TaskStatus:
        """How far it is."""
        causes = dict(sorted(self.causes.items(), key=lambda item: (-item[1], item[0])))
        return TaskStatus(self.name, self.total, self.tried, self.held, self.strict, causes)

    def seed(self, index: int) -> int:
        """Of an episode's reset."""
        return self._record.scene_seed(self.name, index)

    def count(self, index: int, kept: Kept) -> None:
        """Take note of a finished episode."""
        self.done[index] = 1
        self.tried += 1
        self.held += kept.held
        self.strict += kept.strict
        self.size += kept.size
        if kept.cause is not None:
            self.causes[kept.cause] += 1

    def read(self) -> int:
        """Take note of what earlier runs left, remove what is damaged, and return how much that was.

        Raises:
            InputError: an episode is not of this collection, or another version of gensim2 wrote it.
        """
        damaged = 0
        for found in self.store.found():
            if found.row is None:
                found.path.unlink()
                damaged += 1
                continue
            episode = found.row.episode
            foreign = found.index >= self.total or episode.seed != self.seed(found.index)
            if foreign or self.done[found.index]:
                reason = "is not of this collection" if foreign else "is there twice"
                raise InputError(reason, file=found.path, remedy="delete it and resume")
            self.count(found.index, Kept.of(episode, found.path))
        return damaged

    def is_complete(self) -> bool:
        """Whether ``episodes.jsonl`` and all that it tells of are there and whole; then they are taken note of."""
        with contextlib.suppress(InputError):
            for number, row in enumerate(self.store.rows()):
                seems_right = row.index == number < self.total and row.seed == self.seed(number)
                if not seems_right or not self.store.is_complete(row):
                    break
                self.count(number, Kept.of(row, self.store.path(number, row.held)))
            if self.is_done and not self._lies_more_there():
                return True
        self._forget()
        return False

    def _lies_more_there(self) -> bool:
        folders = [self.store.path(0, held).parent for held in (True, False)]
        return sum(len(list(folder.iterdir())) for folder in folders if folder.is_dir()) != self.total

    def jobs(self, evaluator: PoolEvaluator, first: int) -> Iterator[Job]:
        """What is to come, numbered from ``first`` on."""
        setting = evaluator.setting(self.given.spec, self.given.instances)
        for index in range(self.total):
            if not self.done[index]:
                keep = partial(keep_episode, self.store.folder, index, self._record.keep_failures)
                yield Job(first + index, (setting, self.given.strategies, self.seed(index), keep))

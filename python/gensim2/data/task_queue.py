"""Track the finished and missing episodes of one task in a collection.

The quota of a task is a number of episodes for a data set, or a number of successes for demonstrations.
"""

from __future__ import annotations

import bisect
import contextlib
import itertools
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from gensim2.core.errors import InputError, NotRunError
from gensim2.core.files import remove
from gensim2.core.processes import Job
from gensim2.data.status import TaskStatus
from gensim2.data.store import TaskStore
from gensim2.rollout import worker
from gensim2.rollout.record import Episode
from gensim2.rollout.recording import Recording
from gensim2.rollout.runner import EpisodeRunner
from gensim2.rollout.tally import disagree, held_by_engine
from gensim2.scenes.config import Drawn
from gensim2.tasks.spec import TaskSpec
from gensim2.tasks.strategies import Strategies


@dataclass(frozen=True)
class Quota:
    """Number of episodes of a task to collect.

    Attributes:
        limit: largest number of episodes to run.
        held: number of successful episodes after which the collection ends; None: run ``limit`` episodes.
    """

    limit: int
    held: int | None = None


def keep_episode(
    folder: Path, index: int, failures: bool, episode: Episode, recording: Recording | None
) -> tuple[Episode, int]:
    """Write an episode into the folder of its task. Return the episode and the size of the file in bytes.

    Workers call this function.

    Args:
        failures: also store the states of failed episodes.
    """
    store = TaskStore(folder)
    store.add(index, episode, recording if episode.held or failures else None)
    return episode, store.path(index, episode.held).stat().st_size


class TaskQueue:
    """Queue of the episodes of one task.

    Args:
        strategies: strategies by name, as plain data.
        instances: name of the set of objects.
        store: folder of the task.
        seeds: function that returns the scene seed of an episode index.
        quota: number of episodes to collect.
        keep_failures: also store the states of failed episodes.

    Attributes:
        tried, held, strict, causes: counts over the finished episodes.
        engines: number of successful episodes in each physics engine, if every episode is run in both engines.
        disagreed: seeds of the scenes in which only one engine passes `held`.
        size: size of the finished episodes' files, bytes.
    """

    def __init__(
        self,
        task: TaskSpec,
        strategies: Strategies,
        instances: Drawn,
        store: TaskStore,
        seeds: Callable[[int], int],
        quota: Quota,
        *,
        keep_failures: bool = False,
    ) -> None:
        self.task, self.strategies, self.instances, self.store = task, strategies, instances, store
        self.seed, self.quota, self._keep_failures = seeds, quota, keep_failures
        self._forget()

    def _forget(self) -> None:
        self._done, self._holds = bytearray(self.quota.limit), bytearray(self.quota.limit)
        self._under_way: set[int] = set()
        self.tried = self.held = self.strict = self.size = 0
        self.causes: Counter[str] = Counter()
        self.engines: Counter[str] = Counter()
        self.disagreed: set[int] = set()

    @property
    def name(self) -> str:
        return self.task.name

    @property
    def needed(self) -> int | None:
        """Number of episodes, from episode 0 on, that the task needs to fill its quota; None if it is still unknown.

        The number is unknown as long as it depends on the result of an unfinished episode.
        """
        if self.quota.held is None:
            return self.quota.limit if self.tried == self.quota.limit else None
        held = 0
        for index in range(self.quota.limit):
            if not self._done[index]:
                return None
            held += self._holds[index]
            if held == self.quota.held:
                return index + 1
        return self.quota.limit

    @property
    def is_done(self) -> bool:
        return self.needed is not None

    @property
    def status(self) -> TaskStatus:
        causes = dict(sorted(self.causes.items(), key=lambda item: (-item[1], item[0])))
        engines, disagreed = dict(sorted(self.engines.items())), tuple(sorted(self.disagreed))
        return TaskStatus(self.name, self.quota.limit, self.tried, self.held, self.strict, causes, engines, disagreed)

    def count(self, index: int, episode: Episode, size: int) -> None:
        """Count a finished episode, whose file has ``size`` bytes."""
        self._under_way.discard(index)
        self._done[index], self._holds[index] = 1, episode.held
        self.tried += 1
        self.held += episode.held
        self.strict += episode.strict
        self.size += size
        if episode.cause is not None:
            self.causes[str(episode.cause)] += 1
        self.engines.update(held_by_engine([episode]))
        if disagree(episode):
            self.disagreed.add(episode.seed)

    def read(self) -> int:
        """Count the episodes of earlier runs, remove damaged files, and return the number of damaged files.

        Raises:
            InputError: an episode belongs to another collection or was written by an incompatible version of gensim2.
        """
        damaged = 0
        for index, path, episode in self.store.found():
            if episode is None:
                remove(path)
                damaged += 1
                continue
            foreign = index >= self.quota.limit or episode.seed != self.seed(index)
            if foreign or self._done[index]:
                reason = "belongs to another collection" if foreign else "exists twice"
                raise InputError(reason, file=path, remedy="delete the file and resume")
            self.count(index, episode, path.stat().st_size)
        return damaged

    def is_complete(self) -> bool:
        """Return whether ``episodes.jsonl`` and all files that it lists are complete; if so, count the episodes."""
        number = -1
        with contextlib.suppress(InputError):
            for number, row in enumerate(self.store.rows()):
                seems_right = row.index == number < self.quota.limit and row.seed == self.seed(number)
                if not seems_right or not self.store.is_complete(row):
                    break
                self.count(number, row, self.store.path(number, row.held).stat().st_size)
            if self.needed == number + 1 and not self._lies_more_there(number + 1):
                return True
        self._forget()
        return False

    def _lies_more_there(self, count: int) -> bool:
        folders = [self.store.path(0, held).parent for held in (True, False)]
        return sum(len(list(folder.iterdir())) for folder in folders if folder.is_dir()) != count

    def finish(self) -> None:
        """Write ``episodes.jsonl``. Call this method when the task has all of its episodes."""
        assert self.needed is not None
        for _ in self.store.write_rows(self.needed):
            pass

    def jobs(self, evaluator: EpisodeRunner, first: int) -> Iterator[Job | None]:
        """Yield a job for each missing episode, numbered from ``first``.

        The iterator yields None while the results of running jobs decide on the next one.

        An episode is started only if it is needed even when all running episodes succeed. Therefore neither the number
        of workers nor the order of the results changes which episodes are run.
        """
        config = evaluator.config(self.task, self.instances)
        last = self._done.rfind(1)
        for index in range(self.quota.limit):
            if self._done[index]:
                continue
            while self.quota.held is not None and index > last and self.held + len(self._under_way) >= self.quota.held:
                if not self._under_way:
                    return
                yield None
            self._under_way.add(index)
            keep = partial(keep_episode, self.store.folder, index, self._keep_failures)
            yield Job(first + index, (config, self.strategies, self.seed(index), keep))


def run_queues(queues: Sequence[TaskQueue], evaluator: EpisodeRunner, finished: Callable[[TaskQueue], None]) -> None:
    """Run the missing episodes of the queues, task by task, and count each finished episode.

    Args:
        queues: one queue for each task, in the order in which the tasks are run.
        evaluator: pool of workers that runs the episodes.
        finished: callback after each episode, with the episode's queue.

    Raises:
        WriteError: the disk is full; finished episodes are kept.
        NotRunError: some episodes could not be run; all others are finished.
    """
    starts = [0, *itertools.accumulate(queue.quota.limit for queue in queues)]
    jobs = (job for queue, start in zip(queues, starts[:-1], strict=True) for job in queue.jobs(evaluator, start))

    def place(number: int) -> tuple[int, int]:
        owner = bisect.bisect_right(starts, number) - 1
        return owner, number - starts[owner]

    try:
        for number, kept in evaluator.run(worker.record, jobs, "collection"):
            owner, index = place(number)
            queues[owner].count(index, *kept)
            finished(queues[owner])
    except NotRunError as error:
        first, _ = place(min(error.reasons))
        concerned = {place(number)[0] for number in error.reasons}
        others = f" (and of {len(concerned) - 1} other tasks)" if len(concerned) > 1 else ""
        reasons = {place(number)[1]: why for number, why in error.reasons.items() if place(number)[0] == first}
        raise NotRunError(f"episodes of {queues[first].name}{others}", reasons, error.log) from error

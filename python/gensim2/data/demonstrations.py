"""Collect demonstrations: episodes of fresh seeds in order, those that hold are kept, until there are enough."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from gensim2.data.attempt_log import ATTEMPTS, AttemptLog, LoggedEpisode
from gensim2.data.runfolder import RunFolder, TaskFolder
from gensim2.data.trajectory import Provenance, TrajectoryStore
from gensim2.data.video import Replay, film
from gensim2.errors import GenSim2Error
from gensim2.files import remove_temporaries
from gensim2.objects import Library
from gensim2.processes import Job
from gensim2.progress import NULL_PROGRESS, Progress
from gensim2.rollout import worker
from gensim2.rollout.evaluator import PoolEvaluator
from gensim2.rollout.identity import versions
from gensim2.rollout.record import Episode
from gensim2.rollout.recording import Recording
from gensim2.rollout.tally import Tally
from gensim2.seeding import scene_seeds
from gensim2.tasks.spec import TaskSpec
from gensim2.tasks.strategies import Strategies

#: Episodes tried for each demonstration that was asked for, before the collection gives up.
TRIES_PER_DEMO = 5


@dataclass(frozen=True)
class Collected:
    """What a collection left.

    Attributes:
        episodes: those that were run, by index.
        notes: what a reader should know.
    """

    episodes: tuple[Episode, ...]
    notes: tuple[str, ...] = ()

    @property
    def demos(self) -> int:
        """Number of demonstrations."""
        return sum(episode.held for episode in self.episodes)

    @property
    def tally(self) -> Tally:
        """What the episodes add up to."""
        return Tally.of(self.episodes)


def collect(
    task: TaskSpec,
    strategies: Strategies,
    files: TaskFolder,
    run: RunFolder,
    evaluator: PoolEvaluator,
    library: Library,
    instances: str,
    *,
    episodes: int,
    seed: int,
    video: bool = True,
    progress: Progress = NULL_PROGRESS,
) -> Collected:
    """Record demonstrations until ``episodes`` have held, and merge them.

    Each is written when it is finished. A second call makes what is missing: indices that are not logged, and those
    whose file is gone or is not what was logged. Which episodes are kept depends on the seed alone: those of the
    shortest run of indices from 0 that holds enough successes.

    Args:
        instances: which instances episodes draw from, one word.
        episodes: demonstrations wanted.

    Returns:
        Fewer than ``episodes`` demonstrations where too many episodes failed.

    Raises:
        NotRunError: episodes could not be run; all others that may be needed are finished.
        InputError: what an earlier run left cannot be used.
    """
    store = TrajectoryStore(files.path)
    seeds = scene_seeds(seed, task.name, "demos", TRIES_PER_DEMO * episodes)
    log = AttemptLog(files.path / ATTEMPTS, seeds)
    run.add_episodes(library, log.done.values(), log.path)
    damaged = [i for i, entry in log.done.items() if entry.held and store.digest(i) != entry.episode_digest]
    for index in damaged:
        log.forget(index)
    if damaged:
        progress.message(f"{task.name}: {len(damaged)} episode files are gone or damaged and are made again")
    collection = _Collection(log, episodes, len(seeds))
    progress.start(f"{task.name}: demonstrations", episodes)
    progress.advance(min(collection.held, episodes))
    setting = evaluator.setting(task, instances)
    wanted = collection.wanted()
    jobs = (
        Job(i, (setting, strategies, seeds[i], partial(keep_demonstration, files.path, i))) if i is not None else None
        for i in wanted
    )
    for index, (episode, digest) in evaluator.run(worker.record, jobs, f"{task.name}: demonstrations"):
        if digest is not None:
            progress.advance()
        collection.add(LoggedEpisode.of(episode, index, digest))
    remove_temporaries(files.path)  # a worker that was killed while it wrote leaves one
    entries = log.finish(collection.needed())
    run.add_episodes(library, entries, log.path)
    run.save()
    kept = [entry for entry in entries if entry.held]
    foreign = len(set(store.indices()) - {entry.index for entry in kept})
    notes = (f"{task.name}: {foreign} files in episodes/ are not of this run and were left out",) if foreign else ()
    collected = Collected(tuple(entry.episode for entry in entries), notes)
    if not kept:
        return collected
    names = sorted({f"{thing.asset_class}/{thing.id}" for entry in kept for thing in entry.objects.values()})
    store.merge(
        Provenance(
            task=task,
            strategies=strategies,
            assets=evaluator.circumstances.assets,
            licenses={name: run.record.licenses[name] for name in names},
            seed=seed,
            environment=evaluator.circumstances.environment,
            details={"versions": versions(), "attempts": len(entries)},
        ),
        {entry.index: entry.episode_digest for entry in kept},
    )
    if video and not (files.path / "video.mp4").exists():
        _film(files.path, task, evaluator, progress)
    return collected


def keep_demonstration(
    folder: Path, index: int, episode: Episode, recording: Recording | None
) -> tuple[Episode, str | None]:
    """Write an episode that holds into the task's folder; return its record and the digest of its file, if any."""
    if recording is None or not episode.held:
        return episode, None
    return episode, TrajectoryStore(folder).add(index, recording, episode)


class _Collection:
    """Which episodes a collection needs: no more than the same collection with one worker would run.

    An episode is begun only while those that held and those under way, were all of them to hold, are too few. So the
    indices that are run are the same whatever the order in which they are finished.
    """

    def __init__(self, log: AttemptLog, episodes: int, limit: int) -> None:
        self._log, self._episodes, self._limit = log, episodes, limit
        self._under_way: set[int] = set()
        self.held = sum(entry.held for entry in log.done.values())

    def wanted(self) -> Iterator[int | None]:
        """Indices to run; None while what is under way may be enough."""
        last = max(self._log.done, default=-1)
        for index in range(self._limit):
            if index in self._log.done:
                continue
            while index > last and self.held + len(self._under_way) >= self._episodes:
                yield None
            self._under_way.add(index)
            yield index

    def add(self, entry: LoggedEpisode) -> None:
        """Log a finished episode."""
        self._log.add(entry)
        self._under_way.discard(entry.index)
        self.held += entry.held

    def needed(self) -> int:
        """Length of the shortest run of indices from 0 that holds enough successes; all of them where none does."""
        held = 0
        for index in range(len(self._log.done)):
            held += self._log.done[index].held
            if held == self._episodes:
                return index + 1
        return len(self._log.done)


def _film(folder: Path, task: TaskSpec, evaluator: PoolEvaluator, progress: Progress) -> None:
    """Film the first demonstration in a worker; where no picture can be made, say so and go on."""
    from gensim2.sim import rendering

    if not rendering.can_render():
        progress.message(f"{task.name}: no video: {rendering.NO_DRIVER}")
        return
    progress.start(f"{task.name}: film", 1)
    job = Job(0, (folder / "trajectory.h5", folder / "video.mp4", folder / "still.png"))
    try:
        for _ in evaluator.run(film_job, [job], f"{task.name}: film"):
            progress.advance()
    except GenSim2Error as error:
        progress.message(f"{task.name}: no video: {error}")


def film_job(trajectory: Path, video: Path, still: Path) -> int:
    """Film the first episode; return the number of frames."""
    return film(Replay.stored(trajectory), video, still=still).frames

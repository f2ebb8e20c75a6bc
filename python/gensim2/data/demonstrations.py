"""Collect demonstrations: run one episode for each seed until enough episodes have succeeded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.seeding import scene_seeds
from gensim2.data.runfolder import RunFolder, TaskFolder
from gensim2.data.store import TaskStore
from gensim2.data.task_queue import Quota, TaskQueue, run_queues
from gensim2.data.trajectory import TrajectoryMetadata, write_trajectory
from gensim2.data.video import Film, Replay, film
from gensim2.objects import Library
from gensim2.rollout.config import EpisodeConfig
from gensim2.rollout.identity import versions
from gensim2.rollout.record import Episode
from gensim2.rollout.runner import EpisodeRunner
from gensim2.rollout.tally import Tally, engines_record
from gensim2.tasks.spec import TaskSpec
from gensim2.tasks.strategies import Strategies

#: Maximum number of episodes for each requested demonstration. The collection stops at this number.
TRIES_PER_DEMO = 5


@dataclass(frozen=True)
class Collected:
    """Result of a collection.

    Attributes:
        episodes: all episodes that were run, by index.
    """

    episodes: tuple[Episode, ...]

    @property
    def demos(self) -> int:
        return sum(episode.held for episode in self.episodes)

    @property
    def tally(self) -> Tally:
        return Tally.of(self.episodes)


def collect(
    task: TaskSpec,
    strategies: Strategies,
    files: TaskFolder,
    run: RunFolder,
    evaluator: EpisodeRunner,
    library: Library,
    instances: str,
    *,
    episodes: int,
    seed: int,
    videos: int = 1,
    progress: Progress = NULL_PROGRESS,
) -> Collected:
    """Run episodes until ``episodes`` of them have succeeded, and merge these demonstrations into one trajectory file.

    Success means the verdict `held`, in both engines if ``evaluator.rollout.engines`` is ``"both"``.

    Each finished episode is written to its own file, without its states if it failed. A second call repeats the
    episodes whose files are missing or damaged. The collection ends at the first index with enough successes, so the
    result depends only on the seed.

    Args:
        instances: name of the set of objects.
        videos: number of videos. The videos show the first demonstrations, or failed episodes if all episodes failed.

    Returns:
        All episodes that were run. If too many of them failed, there are fewer than ``episodes`` demonstrations.

    Raises:
        NotRunError: episodes could not be run; all other necessary episodes are finished.
        InputError: files of an earlier run cannot be used.
    """
    store = TaskStore(files.path)
    seeds = scene_seeds(seed, task.name, "demos", TRIES_PER_DEMO * episodes)
    queue = TaskQueue(task, strategies, instances, store, seeds.__getitem__, Quota(len(seeds), held=episodes))
    progress.start(f"{task.name}: demonstrations", episodes)
    if not queue.is_complete():
        if damaged := queue.read():
            progress.message(f"{task.name}: {damaged} episode files are damaged; their episodes are run again")
        progress.advance(min(queue.held, episodes))
        held = queue.held

        def counted(queue: TaskQueue) -> None:
            nonlocal held
            progress.advance(queue.held - held)
            held = queue.held

        run_queues([queue], evaluator, counted)
        queue.finish()
    else:
        progress.advance(episodes)
    entries = list(store.rows())
    run.add_episodes(library, entries, store.rows_path)
    run.save()
    kept = [entry for entry in entries if entry.held]
    collected = Collected(tuple(entries))
    if not kept:
        _film_failures(entries[:videos], files, evaluator.config(task, instances), strategies, evaluator)
        return collected
    names = sorted({f"{thing.asset_class}/{thing.id}" for entry in kept for thing in entry.objects.values()})
    write_trajectory(
        files.path,
        TrajectoryMetadata(
            task=task,
            strategies=strategies,
            assets=evaluator.scene.assets,
            licenses={name: run.record.licenses[name] for name in names},
            seed=seed,
            environment=evaluator.scene.environment,
            details={
                "versions": versions(*(each.engine for each in evaluator.scene.in_engines(evaluator.rollout.engines))),
                "attempts": len(entries),
                **engines_record(collected.tally.engines, collected.tally.disagreed),
            },
        ),
        [(store.path(entry.index), entry.episode_digest) for entry in kept],
    )
    _film(store, kept[:videos], task, evaluator, progress)
    return collected


def _film_failures(
    failed: Sequence[Episode],
    files: TaskFolder,
    config: EpisodeConfig,
    strategies: Strategies,
    evaluator: EpisodeRunner,
) -> None:
    """Run failed episodes again and record videos of them; report an error as a message and continue."""
    films = {episode.index: files.path / f"failed_{episode.index:06d}.mp4" for episode in failed}
    jobs = {each.index: (config, strategies, each.seed, films[each.index]) for each in failed}
    missing = {index: job for index, job in jobs.items() if not films[index].exists()}
    evaluator.make_films(film_attempt, missing, f"{config.task.name}: films of failed episodes")


def _film(
    store: TaskStore, kept: Sequence[Episode], task: TaskSpec, evaluator: EpisodeRunner, progress: Progress
) -> None:
    """Record videos of demonstrations in workers; report a failure and continue."""
    from gensim2.data.films import film_path  # imported here, because the module loads the ray caster

    folder = store.folder
    films = [folder / "video.mp4", *(film_path(folder, number) for number in range(1, len(kept)))]
    missing = [number for number in range(len(kept)) if not films[number].exists()]
    stills = [folder / "still.png", *([None] * (len(kept) - 1))]
    jobs = {number: (folder / "trajectory.h5", number, films[number], stills[number]) for number in missing}
    made = evaluator.make_films(film_job, jobs, f"{task.name}: film")
    for sentence in dict.fromkeys(each.renderer for each in made):
        progress.message(f"{task.name}: in the films, {sentence}")


def film_job(trajectory: Path, episode: int, video: Path, still: Path | None) -> Film:
    """Record a video of one episode of a trajectory."""
    return film(Replay.stored(trajectory, episode), video, still=still)


def film_attempt(config: EpisodeConfig, strategies: Strategies, seed: int, video: Path) -> Episode:
    """Run an episode again in a worker process and make a video of it by ray casting, even if it fails."""
    from gensim2.data.films import film_again

    return film_again(config, strategies, seed, video)

"""One task of a gallery: which episode is shown, and what was filmed of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gensim2.core.errors import GenSim2Error
from gensim2.core.seeding import scene_seeds
from gensim2.data.demonstrations import TRIES_PER_DEMO
from gensim2.data.runfolder import TaskFolder
from gensim2.data.video import Replay, film
from gensim2.design.description import description_of
from gensim2.rollout import worker
from gensim2.rollout.config import EpisodeConfig
from gensim2.rollout.episode_log import ATTEMPTS, EpisodeLog
from gensim2.rollout.inputs import TaskInput
from gensim2.rollout.record import Episode
from gensim2.tasks.strategies import Strategies

VIDEO, STILL = "video.mp4", "still.webp"

STRIDE = 4
"""Control steps from one frame to the next: without a GPU a picture takes a tenth of a second."""
SPEED = 2
"""Speed of films relative to real time."""


class GalleryEntry:
    """Pictures of one task of a gallery, present and planned.

    Args:
        given: the task.
        files: its folder.
        seed: of the gallery.

    Attributes:
        description: everything that is known of the task, as plain data.
        seeds: of the episodes that are tried until one holds: those of ``gensim2 demo --episodes 1`` with this seed.
        log: of those that were.

    Raises:
        InputError: what an earlier run left cannot be used.
    """

    def __init__(self, given: TaskInput, files: TaskFolder, seed: int) -> None:
        self.spec, self.strategies, self.folder = given.spec, given.strategies, files.path
        files.write_task(given.spec)
        files.write_strategies(given.strategies)
        self.description = description_of(given.spec, given.strategies, given.library)
        self.seeds = scene_seeds(seed, given.spec.name, "demos", TRIES_PER_DEMO)
        self.log = EpisodeLog(files.path / ATTEMPTS, self.seeds)

    @property
    def name(self) -> str:
        """Of the task."""
        return self.spec.name

    @property
    def episodes(self) -> list[Episode]:
        """Those that were tried, in order."""
        return [self.log.done[index] for index in sorted(self.log.done)]

    @property
    def shown(self) -> Episode | None:
        """The episode in the film; None where none has held."""
        return next((episode for episode in self.episodes if episode.held), None)

    @property
    def is_finished(self) -> bool:
        """Whether there is a film, or none to be made."""
        if self.shown is None:
            return len(self.log.done) == len(self.seeds)
        return all((self.folder / name).is_file() for name in (VIDEO, STILL))

    @property
    def video(self) -> str | None:
        """Path of the film in the gallery."""
        return self._place(VIDEO)

    @property
    def still(self) -> str | None:
        """Path of the picture in the gallery."""
        return self._place(STILL)

    def finish(self, episodes: Sequence[Episode]) -> None:
        """Log the episodes that were tried; the last may have been filmed."""
        for index in list(self.log.done):
            self.log.forget(index)
        for index, episode in enumerate(episodes):
            self.log.add(index, episode)
        self.log.finish(len(episodes))

    def _place(self, name: str) -> str | None:
        there = self.is_finished and self.shown is not None
        return f"{self.folder.parent.name}/{self.folder.name}/{name}" if there else None


def film_one_that_holds(
    config: EpisodeConfig, strategies: Strategies, seeds: Sequence[int], folder: Path
) -> list[Episode]:
    """Run episodes until one holds, and film that one; runs in a worker.

    Returns:
        The episodes that were run, in the order of the seeds; the last held, unless none did.

    Raises:
        GenSim2Error: the replay that was filmed does not end in the goal.
    """
    tried = []
    for seed in seeds:
        episode, recording = worker.demonstrate(config, strategies, seed)
        tried.append(episode)
        if recording is None:
            continue
        given = config.scene
        replay = Replay.of(recording, config.task, given.assets, given.environment)
        filmed = film(replay, folder / VIDEO, still=folder / STILL, stride=STRIDE, speed=SPEED)
        if not filmed.success:
            raise GenSim2Error(f"{config.task.name}: the replay of seed {seed} does not end in the goal")
        break
    return tried

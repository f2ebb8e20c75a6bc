"""Write the page of ``gensim2 tasks gallery``, with a video of one successful episode for each task."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Unpack

from gensim2.core.errors import GenSim2Error
from gensim2.core.files import write_atomic
from gensim2.core.pages import template
from gensim2.core.plural import plural
from gensim2.core.processes import Execution
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.record_files import SCHEMA_VERSION
from gensim2.core.seeding import scene_seeds
from gensim2.data.demonstrations import TRIES_PER_DEMO
from gensim2.data.runfolder import RunFolder, TaskFolder
from gensim2.data.video import Film, Replay, film
from gensim2.design.description import description_of
from gensim2.rollout import worker
from gensim2.rollout.config import EpisodeConfig, EvaluationArguments
from gensim2.rollout.episode_log import ATTEMPTS, EpisodeLog
from gensim2.rollout.identity import identity
from gensim2.rollout.inputs import TaskInput, read_task_inputs
from gensim2.rollout.record import Episode
from gensim2.rollout.runner import EpisodeRunner
from gensim2.scenes.config import SceneOptions
from gensim2.tasks.library import packaged_names, task_names, user_library
from gensim2.tasks.strategies import Strategies

VIDEO, STILL = "video.mp4", "still.webp"

STRIDE = 4
"""Control steps between video frames; without a GPU each frame takes a tenth of a second."""
SPEED = 2
"""Playback speed relative to real time."""


class GalleryEntry:
    """Video and still image of one task in a gallery.

    Args:
        given: task with its strategies.
        files: the task's folder.
        seed: seed of the gallery.

    Attributes:
        description: description of the task as plain data.
        seeds: seeds of the scenes, tried in order until an episode succeeds, as in ``gensim2 demo --episodes 1``.
        log: log file of the episodes that were run.

    Raises:
        InputError: files of an earlier run cannot be used.
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
        """Name of the task."""
        return self.spec.name

    @property
    def episodes(self) -> list[Episode]:
        """Episodes that were run, in the order of their seeds."""
        return [self.log.done[index] for index in sorted(self.log.done)]

    @property
    def shown(self) -> Episode | None:
        """The successful episode shown in the video, or None."""
        return next((episode for episode in self.episodes if episode.held), None)

    @property
    def is_finished(self) -> bool:
        """Whether the video exists, or every episode failed."""
        if self.shown is None:
            return len(self.log.done) == len(self.seeds)
        return all((self.folder / name).is_file() for name in (VIDEO, STILL))

    @property
    def video(self) -> str | None:
        """Path of the video relative to the gallery, or None."""
        return self._place(VIDEO)

    @property
    def still(self) -> str | None:
        """Path of the still image relative to the gallery, or None."""
        return self._place(STILL)

    def finish(self, episodes: Sequence[Episode]) -> None:
        """Write the log of the episodes that were run. The video shows the last of them."""
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
) -> tuple[list[Episode], Film | None]:
    """Run episodes until one succeeds, and record a video of that episode; runs in a worker process.

    Returns:
        The episodes in the order of the seeds, and the video. The last episode succeeded, or all failed.

    Raises:
        GenSim2Error: the replay for the video does not reach the goal.
    """
    tried, filmed = [], None
    for seed in seeds:
        episode, recording = worker.demonstrate(config, strategies, seed)
        tried.append(episode)
        if recording is None:
            continue
        filmed = film(
            Replay.of(recording, config.scene), folder / VIDEO, still=folder / STILL, stride=STRIDE, speed=SPEED
        )
        if filmed.success is False:
            raise GenSim2Error(f"{config.task.name}: the replay of seed {seed} does not reach the goal")
        break
    return tried, filmed


INDEX = "index.html"


@dataclass(frozen=True)
class TasksGallery:
    """Result of ``tasks_gallery``.

    Attributes:
        index: path of the page.
        shown: for each task with a video, the seed of the episode in the video.
        without: for each task without a successful episode, the cause of the last failure.
        skipped: for each task that cannot be run with these objects, the reason.
    """

    index: Path
    shown: dict[str, int]
    without: dict[str, str]
    skipped: dict[str, str]

    def to_dict(self) -> dict[str, Any]:
        """Return a dictionary for JSON."""
        return {"schema_version": SCHEMA_VERSION, **asdict(self), "index": str(self.index)}


def tasks_gallery(
    tasks: Sequence[str] = (),
    *,
    origin: str | None = None,
    out: Path,
    seed: int = 0,
    resume: bool = False,
    progress: Progress = NULL_PROGRESS,
    **scene: Unpack[EvaluationArguments],
) -> TasksGallery:
    """Write a page that shows a successful episode, the sentence, the steps and the success rates of each task.

    The page is updated after every task. Videos are H.264 files of about 100 kB.

    Args:
        tasks: names of library tasks, or folders that hold task.yaml and strategies/; empty: all tasks of ``origin``.
        origin: origin of the tasks if ``tasks`` is empty; None: the paper's suite.
        out: output folder.
        seed: seed of the scenes; the page shows the first successful episode of up to five scenes.
        resume: continue the gallery in ``out``.
        progress: progress listener.
        scene: see :class:`~gensim2.rollout.config.EvaluationArguments`.

    Raises:
        InputError: an argument cannot be used.
        NotRunError: some tasks could not be run; the others are finished. Call again with ``resume``.

    Example:
        ```python
        gallery = tasks_gallery(["OpenDrawer", "CloseBox"], out=Path("gallery"), assets="builtin")
        print(gallery.index)
        ```
    """
    execution = Execution.of(scene)
    given, skipped = read_task_inputs(tasks, seed=seed, origin=origin, **scene)
    options, rollout, library = given[0].scene.options, given[0].rollout, given[0].library
    with (
        RunFolder(
            out,
            {
                "command": "tasks gallery",
                "stored_tasks": [one.spec.name for one in given],
                "seed": seed,
                **options.to_record(),
                **rollout.to_record(),
                "workers": execution.workers,
            },
            identity(given),
            resume,
        ) as folder,
        EpisodeRunner(options, execution, progress, log=folder.errors_log) as evaluator,
    ):
        again = _again(given, seed)
        shelves = [GalleryEntry(one, folder.task(one.spec.name), seed) for one in given]
        for shelf in shelves:
            folder.add_episodes(library, shelf.episodes, shelf.log.path)

        def write_page() -> None:
            folder.save()
            page = template("gensim2.design", "tasks.html.j2").render(
                run=folder.record.model_dump(), shelves=shelves, skipped=skipped, speed=SPEED, again=again
            )
            write_atomic(folder.path / INDEX, page)

        missing = sum(not shelf.is_finished for shelf in shelves)
        progress.message(
            f"{plural(missing, 'video')} to make; each takes half a minute without a GPU, longer on busy cores"
        )
        progress.start("tasks", len(shelves))
        progress.advance(sum(shelf.is_finished for shelf in shelves))
        write_page()
        jobs = {
            index: (evaluator.config(shelf.spec, "all"), shelf.strategies, shelf.seeds, shelf.folder)
            for index, shelf in enumerate(shelves)
            if not shelf.is_finished
        }
        renderers: set[str] = set()
        for index, (episodes, filmed) in evaluator.each(film_one_that_holds, jobs, "films"):
            if filmed is not None and filmed.renderer not in renderers:
                progress.message(f"in the films, {filmed.renderer}")
                renderers.add(filmed.renderer)
            shelves[index].finish(episodes)
            folder.add_episodes(library, episodes, shelves[index].log.path)
            write_page()
        result = TasksGallery(
            folder.path / INDEX,
            {shelf.name: shelf.shown.seed for shelf in shelves if shelf.shown is not None},
            {shelf.name: str(shelf.episodes[-1].cause) for shelf in shelves if shelf.shown is None},
            skipped,
        )
        folder.finish(result.to_dict())
        write_page()
    return result


def _again(given: Sequence[TaskInput], seed: int) -> str:
    """Return the shell command that repeats the episode of a video. The word ``TASK`` stands for the task's name."""
    options = given[0].scene.options
    words = ["gensim2", "demo", "TASK", "--episodes", "1", "--seed", str(seed), "--assets", options.assets]
    words += [word for name in ("engine", "physics", "robot") for word in _unless_default(options, name)]
    own = set(task_names()) - set(packaged_names())
    if (library := user_library()) is not None and any(one.spec.name in own for one in given):
        words += ["--library", str(library)]
    return shlex.join(words)


def _unless_default(options: SceneOptions, name: str) -> list[str]:
    value = options.environment.get(name)
    return [] if value is None else [f"--{name}", value]

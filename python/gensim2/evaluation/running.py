"""The episodes of one task in a table: the same scenes whoever acts, each logged as soon as it is finished."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gensim2.core.progress import Progress
from gensim2.rollout.record import Episode
from gensim2.tasks.spec import TaskSpec

if TYPE_CHECKING:
    from gensim2.data.runfolder import RunFolder
    from gensim2.rollout.runner import EpisodeRunner


def run_episodes(
    task: TaskSpec,
    folder: Path,
    evaluator: EpisodeRunner,
    function: Callable[..., Episode],
    arguments: Callable[[int, int], tuple[Any, ...]],
    *,
    runs: int,
    episodes: int,
    seed: int,
    progress: Progress,
) -> tuple[list[Episode], float | None]:
    """All episodes of a task, run after run, and how many a second were run; those that its log holds are not.

    Args:
        folder: of the task, in which the log lies.
        function: of :mod:`gensim2.rollout.worker`.
        arguments: gives those of the function for an episode's index and seed.
        runs, episodes: how many runs of how many episodes.
        seed: of the scenes; a benchmark and an evaluation with one seed have the same ones.
    """
    from gensim2.core.processes import Job
    from gensim2.core.seeding import scene_seeds
    from gensim2.data.attempt_log import ATTEMPTS, AttemptLog, LoggedEpisode

    seeds = [each for run in range(runs) for each in scene_seeds(seed, task.name, f"benchmark/{run}", episodes)]
    log = AttemptLog(folder / ATTEMPTS, seeds)
    progress.start(task.name, len(seeds))
    progress.advance(len(log.done))
    jobs = [Job(i, arguments(i, seeds[i])) for i in range(len(seeds)) if i not in log.done]
    begin = time.perf_counter()
    for index, episode in evaluator.run(function, jobs, f"{task.name}: episodes"):
        log.add(LoggedEpisode.of(episode, index))
        progress.advance()
    speed = round(len(jobs) / (time.perf_counter() - begin), 4) if jobs else None
    return [entry.episode for entry in log.finish(len(seeds))], speed


def finish_table(folder: RunFolder, told: dict[str, Any]) -> None:
    """Write the outcome of a table into its run folder, and finish the run.

    A folder is the same on whatever day and by however many commands it was made, so it says nothing of ``provenance``;
    the ``records`` of episodes stand in the tasks' folders.

    Args:
        folder: of the run.
        told: the result as plain data; left as it is.
    """
    tasks = [{name: value for name, value in task.items() if name != "records"} for task in told["tasks"]]
    folder.finish({name: value for name, value in {**told, "tasks": tasks}.items() if name != "provenance"})

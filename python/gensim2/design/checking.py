"""Check the success criteria of a task before it is searched, verified or added to a library."""

from __future__ import annotations

from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.seeding import scene_seeds
from gensim2.data.runfolder import TaskFolder
from gensim2.rollout import worker
from gensim2.rollout.checker_result import CheckerResult
from gensim2.rollout.runner import EpisodeRunner
from gensim2.scenes.config import Drawn
from gensim2.tasks.spec import TaskSpec

SCENES = 10
"""Number of scenes whose mutated worlds check a task. A scene has 4 to 40 worlds."""

CHANGE_GOAL = "add a criterion about the object that was not moved, or a stricter threshold"
"""Remedy for a task whose success criteria are refused."""


def check_criteria(
    task: TaskSpec,
    evaluator: EpisodeRunner,
    instances: Drawn,
    *,
    seed: int,
    scenes: int = SCENES,
    files: TaskFolder | None = None,
    progress: Progress = NULL_PROGRESS,
) -> CheckerResult:
    """Count how often the success criteria of a task are wrongly true. The criteria are checked in mutated worlds:
    scenes that were changed on purpose so that the task is not done (docs/reference/tasks.md). In such a scene, the
    criteria must be false.

    Args:
        task: task to check; its strategies are not used.
        evaluator: worker pool that builds the worlds.
        instances: instances of the objects.
        seed: seed of the scenes.
        scenes: number of scenes.
        files: the task's folder, in which ``checker.json`` stores the result; a second call reads the file.
        progress: progress listener.

    Raises:
        NotRunError: some scenes could not be built.
        InputError: the file cannot be used, or the task's goal is met at the start of every episode.
    """
    if files is not None and (found := files.checker()) is not None:
        return found
    what = f"{task.name}: check of the success criteria"
    progress.start(what, scenes)
    config = evaluator.config(task, instances)
    jobs = {n: (config, each) for n, each in enumerate(scene_seeds(seed, task.name, "checker", scenes))}
    judged = dict(evaluator.each(worker.judge_scene, jobs, what))
    result = CheckerResult.of([judged[n] for n in range(scenes)])
    if files is not None:
        files.write_checker(result)
    return result

"""``gensim2 collect``: run episodes whose outcome depends only on seed, task and index."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Unpack

from gensim2.core.processes import Execution
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.data.record import DatasetRecord, TaskRecord
from gensim2.data.status import Status
from gensim2.rollout.config import RunArguments
from gensim2.rollout.counted_objects import all_with_objects, can_be_counted
from gensim2.rollout.inputs import TaskInput, check_counts, only_strategies, read_task_inputs, require_true_scene
from gensim2.scenes.physics import Engines

SCHEMA_VERSION = 1
"""Version of the command's JSON output."""


@dataclass(frozen=True)
class CollectionResult:
    """Result of a collection.

    Attributes:
        folder: folder of the data set.
        status: final status.
        skipped: reason for each task that was skipped, by task name. A task is skipped if no available object suits it.
        cpu_s: CPU time of all worker processes in this call, s, without the time to start the processes.
    """

    folder: Path
    status: Status
    skipped: dict[str, str]
    cpu_s: float

    def to_dict(self) -> dict[str, Any]:
        status = self.status
        return {
            "schema_version": SCHEMA_VERSION,
            "folder": str(self.folder),
            "tasks": [task.to_dict() for task in status.tasks],
            "episodes": status.tried,
            "held": sum(task.held for task in status.tasks),
            "episodes_run": status.ran,
            "episodes_per_second": None if status.rate is None else round(status.rate, 4),
            "failed_tries": status.failed_tries,
            "bytes": status.stored,
            "skipped": self.skipped,
            "cpu_s": round(self.cpu_s, 3),
        }


def collect(
    tasks: Sequence[str] = (),
    *,
    episodes: int,
    out: Path | str,
    seed: int = 0,
    keep_failures: bool = False,
    noise: float = 0.0,
    strategy: Sequence[str] = (),
    objects: int | None = None,
    engines: Engines = "one",
    resume: bool = False,
    listener: Progress = NULL_PROGRESS,
    **scene: Unpack[RunArguments],
) -> CollectionResult:
    """Collect a data set of demonstrations; each episode is stored as soon as it is finished.

    Example:
        ```python
        gensim2.collect(["OpenDrawer"], episodes=100, out="night", assets="builtin")
        frames = gensim2.DataSet.open("night").frames()
        ```

    Args:
        tasks: names of library tasks, or folders with task.yaml and strategies/; empty for the whole suite. A task
            whose object classes are not available is skipped and listed in the result.
        episodes: number of episodes to run for each task.
        out: folder of the data set.
        seed: seed of the scenes. Other commands with this seed use different scenes.
        keep_failures: also store the states of failed episodes; their records are always stored.
        noise: standard deviation, rad, of occasional disturbances of the arm's commands; the undisturbed commands are
            recorded as well (:mod:`gensim2.rollout.worker`).
        strategy: names of strategies. A step that has one of these strategies uses no other strategy.
        objects: number of generated objects of each articulated class, instead of ``instances``; not with built-in or
            ``"new"`` objects.
        engines: ``"both"`` repeats each episode on the same scene in the other engine, and a demonstration must succeed
            in both (verdict `held`). Recorded states come from the first engine.
        resume: continue the data set in ``out``, possibly with more episodes or tasks.
        listener: receives the status of all tasks.
        scene: options of scenes, strategies and worker processes: see :class:`~gensim2.rollout.config.RunArguments`.

    Returns:
        Counts of the episodes by task, and the skipped tasks.

    Raises:
        InputError: an argument is invalid, or the existing data set cannot be continued.
        WriteError: the disk is full; finished episodes are kept, and ``resume`` continues.
        NotRunError: some episodes could not be run; all others are finished, and ``resume`` retries them.
    """
    check_counts(episodes=episodes)
    require_true_scene(**scene)
    execution = Execution.of(scene)
    given, skipped = read_task_inputs(tasks, seed=seed, **scene)
    if objects is not None:
        check_counts(objects=objects)
        counted = all_with_objects(given, objects, seed)
        given = [replace(one, instances=word.instances) for one, word in zip(counted, given, strict=True)]
    given[0].scene.second_engine(engines)  # raises an error now if the second engine cannot be used
    given = [
        replace(one, rollout=replace(one.rollout, noise=noise, engines=engines))
        for one in only_strategies(given, strategy)
    ]
    # Import these modules late, because importing them takes long.
    from gensim2.data.queue import ERRORS_LOG, CollectionFolder, Queue
    from gensim2.rollout.runner import EpisodeRunner

    with CollectionFolder(
        Path(out), _description(given, seed, episodes, keep_failures, objects), resume, execution.to_record()
    ) as folder:
        queue = Queue(folder, given, listener)
        with EpisodeRunner(
            given[0].scene.options, execution, listener, rollout=given[0].rollout, log=folder.path / ERRORS_LOG
        ) as evaluator:
            status = queue.run(evaluator)
            return CollectionResult(folder.path, status, skipped, evaluator.cpu_s)


def _description(
    given: Sequence[TaskInput], seed: int, episodes: int, keep_failures: bool, objects: int | None
) -> DatasetRecord:
    """Return the initial contents of ``dataset.json``, before any episode is run."""
    from gensim2.rollout.identity import digest, listings, versions

    return DatasetRecord(
        arguments={**given[0].scene.options.to_record(), **given[0].rollout.to_record()},
        seed=seed,
        episodes=episodes,
        keep_failures=keep_failures,
        tasks={
            one.spec.name: TaskRecord(
                digest=digest([one.spec.model_dump(mode="json"), one.strategies]),
                instances=one.instances,
                objects=objects if can_be_counted(one) else None,
            )
            for one in given
        },
        listings=listings(given),
        versions=versions(*(each.engine for each in given[0].scene.in_engines(given[0].rollout.engines))),
    )

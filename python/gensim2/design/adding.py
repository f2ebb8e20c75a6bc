"""A task made by hand, verified and added to the user's library: ``gensim2 tasks add FOLDER``."""

from __future__ import annotations

from pathlib import Path
from typing import Unpack

from gensim2.core.errors import InputError
from gensim2.core.processes import Execution
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.seeding import scene_seeds
from gensim2.data.records import Verification
from gensim2.design.remembering import Remembered, verified
from gensim2.design.unseen import kept_apart
from gensim2.rollout.config import RunArguments
from gensim2.rollout.inputs import check_counts, read_task_input
from gensim2.rollout.runner import EpisodeRunner
from gensim2.tasks.library import origin_of
from gensim2.tasks.memory import LEAST_EPISODES, LEAST_SHARE, Memory, UnverifiedTaskError
from gensim2.tasks.spec import Provenance

BY_HAND = "hand"
"""Origin of a task that names none."""


def add_task(
    folder: Path,
    *,
    episodes: int = LEAST_EPISODES,
    seed: int = 0,
    memory: Memory | None = None,
    progress: Progress = NULL_PROGRESS,
    **given: Unpack[RunArguments],
) -> Remembered:
    """Run fresh episodes of a task with its strategies and add it to a library where enough of them hold.

    Args:
        folder: holds task.yaml and strategies/.
        episodes: of the verification, at least ``LEAST_EPISODES``.
        seed: of the scenes.
        memory: default: the user's library.
        progress: listener.
        given: see :class:`~gensim2.rollout.config.RunArguments`.

    Raises:
        InputError: the folder or an argument cannot be used, or there is no library.
        KnownTaskError: the library has the task already, which is said before anything is run.
        UnverifiedTaskError: too few episodes held; says how many, and why the others did not.
        NotRunError: episodes could not be run.
    """
    check_counts(episodes=episodes)
    execution = Execution.of(given)
    if episodes < LEAST_EPISODES:
        raise InputError(f"must be at least {LEAST_EPISODES}, not {episodes}", field="episodes")
    memory = memory or Memory()
    library_folder = str(memory.folder)
    read = read_task_input(str(folder), seed=seed, **given)
    task = read.spec
    if origin_of(task) is None:
        task = task.model_copy(update={"provenance": Provenance(origin=BY_HAND)})
    memory.check_new(task, read.strategies)
    seeds = scene_seeds(seed, task.name, "verify", episodes)
    # What its author tried it on is unknown, so that generated objects are new ones and others any of the folder's.
    apart = kept_apart(read.library, task)
    drawn = apart.verification(episodes, seed) if read.instances == "all" else [read.instances] * episodes
    kind = apart.kind if read.instances == "all" else "all"
    progress.start(f"{task.name}: verify", episodes)
    with EpisodeRunner(read.scene.options, execution, progress, rollout=read.rollout) as evaluator:
        jobs = [(evaluator.config(task, drawn[i]), read.strategies, seeds[i]) for i in range(episodes)]
        found = evaluator.episodes(f"{task.name}: verification", jobs)
    verification = Verification(tuple(found), LEAST_SHARE, kind)
    if not verification.kept:
        causes = ", ".join(f"{count} {cause}" for cause, count in verification.tally.causes.items())
        raise UnverifiedTaskError(
            f"{task.name}: {verification.tally.held} of {episodes} fresh episodes held ({causes})",
            file=folder,
            remedy=f"{LEAST_SHARE:g} of them must hold",
        )
    memory.add(task, read.strategies, verified(verification, seed))
    return Remembered(library_folder, (task.name,), {})

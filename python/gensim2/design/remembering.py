"""Add kept tasks to the user's library, for ``gensim2 tasks add`` and at the end of ``run-pipeline``."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Unpack

from gensim2.core.errors import InputError
from gensim2.core.processes import Execution
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.record_files import read_record
from gensim2.core.seeding import scene_seeds
from gensim2.data.records import RunRecord, Verification
from gensim2.data.runfolder import RUN_JSON, TaskFolder
from gensim2.design.checking import check_criteria, remedy_for
from gensim2.design.execution import repeated
from gensim2.design.unseen import kept_apart
from gensim2.rollout.config import RunArguments
from gensim2.rollout.inputs import check_counts, read_task_input
from gensim2.rollout.runner import EpisodeRunner
from gensim2.rollout.tally import interval
from gensim2.scenes.physics import Engines
from gensim2.tasks.library import PAPER, load_strategies_beside, load_task_file, origin_of, packaged_names, task_names
from gensim2.tasks.memory import LEAST_EPISODES, LEAST_SHARE, KnownTaskError, Memory, UnverifiedTaskError
from gensim2.tasks.spec import Provenance, Verified

BY_HAND = "hand"
"""Origin of a task whose spec names no origin."""


def add_task(
    folder: Path,
    *,
    episodes: int = LEAST_EPISODES,
    seed: int = 0,
    engines: Engines = "one",
    memory: Memory | None = None,
    progress: Progress = NULL_PROGRESS,
    **given: Unpack[RunArguments],
) -> Remembered:
    """Run fresh episodes of a task and add it to a library if enough of them succeed.

    Args:
        folder: folder that holds task.yaml and strategies/.
        episodes: number of verification episodes, at least ``LEAST_EPISODES``.
        seed: seed of the scenes.
        engines: ``"both"`` also verifies in the other engine. A task is added only if it passes in both.
        memory: task library; default: the user's library.
        given: see :class:`~gensim2.rollout.config.RunArguments`.

    Raises:
        InputError: the folder or an argument cannot be used, or no task library exists.
        KnownTaskError: the library already contains the task. This error is raised before any episode runs.
        UnverifiedTaskError: criteria hold in scenes in which the task is not done, or too few episodes succeeded. The
            message has numbers and causes.
        NotRunError: some episodes could not be run.
    """
    check_counts(episodes=episodes)
    execution = Execution.of(given)
    if episodes < LEAST_EPISODES:
        raise InputError(f"must be at least {LEAST_EPISODES}, not {episodes}", field="episodes")
    memory = memory or Memory()
    library_folder = str(memory.folder)
    read = read_task_input(str(folder), seed=seed, **given)
    task, second = read.spec, read.scene.second_engine(engines)
    if origin_of(task) is None:
        task = task.model_copy(update={"provenance": Provenance(origin=BY_HAND)})
    memory.check_new(task, read.strategies)
    seeds = scene_seeds(seed, task.name, "verify", episodes)
    # The author's objects are unknown. Therefore the task is verified as a designed task is: with new objects of
    # generated classes, with the test split of real classes, or with the whole class if the split is too small.
    apart = kept_apart(read.library, task)
    drawn = apart.verification(episodes, seed) if read.instances == "all" else [read.instances] * episodes
    kind = apart.kind if read.instances == "all" else "all"
    with EpisodeRunner(read.scene.options, execution, progress, rollout=read.rollout) as evaluator:
        searched = apart.search if read.instances == "all" else read.instances
        checker = check_criteria(task, evaluator, searched, seed=seed, progress=progress)
        if not checker.passes:
            remedy = remedy_for(task, checker, read.scene.options)
            raise UnverifiedTaskError(f"{task.name}: {checker.reason}", file=folder, field="goal", remedy=remedy)
        progress.start(f"{task.name}: verify", episodes)
        jobs = [(evaluator.config(task, drawn[i]), read.strategies, seeds[i]) for i in range(episodes)]
        found = evaluator.episodes(f"{task.name}: verification", jobs)
        verification = Verification(tuple(found), LEAST_SHARE, kind)
        if second is not None and verification.kept:
            verification = replace(verification, second=repeated(jobs, second, task.name, evaluator))
    if not verification.kept:
        tally, where = verification.tally, ""
        if verification.second is not None:
            tally, where = verification.second.tally, f" in {verification.second.engine}"
        causes = ", ".join(f"{count} {cause}" for cause, count in tally.causes.items())
        wrong = f"{task.name}: {tally.held} of {episodes} fresh episodes succeeded{where}; failures by cause: {causes}"
        raise UnverifiedTaskError(wrong, file=folder, remedy=f"the success rate must be at least {LEAST_SHARE:g}")
    memory.add(task, read.strategies, verified(verification, seed))
    return Remembered(library_folder, (task.name,), {})


@dataclass(frozen=True)
class Remembered:
    """Result of adding the tasks that a run kept.

    Attributes:
        library: folder of the task library; None: no library exists.
        added: names of the run's tasks that are now in the library.
        left_out: names of the kept tasks that were not added, with the reasons.
    """

    library: str | None
    added: tuple[str, ...]
    left_out: dict[str, str]


def verified(verification: Verification, seed: int) -> Verified:
    """Summarize the episodes of a verification for a task's provenance.

    Args:
        verification: result of the verification of the task.
        seed: seed of the run.
    """
    tally = verification.tally
    low, high = interval(tally.held, tally.episodes)
    return Verified(
        episodes=tally.episodes,
        held=tally.held,
        paper=tally.paper,
        strict=tally.strict,
        interval=(round(low, 4), round(high, 4)),
        seed=seed,
        instances=verification.instances,
        objects=tally.objects,
    )


def known_before(run: Path | None) -> tuple[str, ...]:
    """Return the names of the library's tasks, except tasks that this run added before an interruption.

    Args:
        run: run folder; None: the run is new.
    """
    memory = Memory()
    if run is None or not memory.is_there:
        return task_names()
    own = str(run.resolve())
    return tuple(name for name in task_names() if name in packaged_names() or memory.run_of(name) != own)


def _verify_anew(folder: Path, record: RunRecord) -> str:
    """Return the shell command that repeats a task's verification with the objects and scenes of its run."""
    words = ["gensim2", "tasks", "add", str(folder)]
    for name in ("assets", "instances", "engine", "physics", "robot", "randomization"):
        told = record.arguments.get(name)
        # Leave out a value that is not a string. For example, the record does not contain the path of a physics file.
        if isinstance(told, str):
            words += [f"--{name}", told]
    return shlex.join(words)


def remember(run: Path, memory: Memory | None = None) -> Remembered:
    """Add the tasks that a run designed and kept to a library; repeated calls change nothing.

    Args:
        run: folder of ``gensim2 run-pipeline``.
        memory: task library; default: the user's library.

    Raises:
        InputError: the run folder is missing or damaged, or the library cannot be written to.
    """
    memory = memory or Memory()
    if not memory.is_there:
        return Remembered(None, (), {})
    path = run / RUN_JSON
    if not path.is_file():
        raise InputError(
            "contains no run",
            file=run,
            remedy="give the output folder of gensim2 run-pipeline, or a folder that contains task.yaml",
        )
    record = read_record(path, RunRecord, "restore the file")
    added, left_out = [], {}
    for folder in sorted((run / "tasks").glob("*/")):
        verification = TaskFolder(folder).verification()
        task = load_task_file(folder)
        if origin_of(task) == PAPER:
            continue
        if verification is None or origin_of(task) is None:
            left_out[task.name] = "the run did not verify it; `gensim2 tasks add` of the task's own folder does"
            continue
        if not verification.kept:
            left_out[task.name] = f"{verification.tally.held} of {len(verification.episodes)} episodes held"
            continue
        told = verified(verification, record.arguments["seed"])
        try:
            memory.add(task, load_strategies_beside(folder, task), told, run=str(run.resolve()))
            added.append(task.name)
        except KnownTaskError as error:
            left_out[task.name] = str(error)
        except UnverifiedTaskError as error:
            left_out[task.name] = f"{error}; `{_verify_anew(folder, record)}` verifies it anew"
    return Remembered(str(memory.folder), tuple(added), left_out)

"""Import of a run's kept tasks into the user's library: ``gensim2 tasks add``, and the end of ``run-pipeline``."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path

from gensim2.core.errors import InputError
from gensim2.core.record_files import read_record
from gensim2.data.records import RunRecord, Verification
from gensim2.data.runfolder import RUN_JSON, TaskFolder
from gensim2.rollout.tally import interval
from gensim2.tasks.library import (
    PAPER,
    load_strategies_beside,
    load_task_file,
    origin_of,
    packaged_names,
    task_names,
)
from gensim2.tasks.memory import KnownTaskError, Memory, UnverifiedTaskError
from gensim2.tasks.spec import Verified


@dataclass(frozen=True)
class Remembered:
    """Outcome for the tasks that a run kept.

    Attributes:
        library: folder of the library; None: there is none.
        added: names of those that are in the library now.
        left_out: why the others are not, by name.
    """

    library: str | None
    added: tuple[str, ...]
    left_out: dict[str, str]


def verified(verification: Verification, seed: int) -> Verified:
    """Summarise the episodes of a verification, as part of a task's provenance.

    Args:
        verification: of the task.
        seed: of the run.
    """
    tally = verification.tally
    low, high = interval(tally.held, tally.episodes)
    return Verified(
        episodes=tally.episodes,
        held=tally.held,
        interval=(round(low, 4), round(high, 4)),
        seed=seed,
        instances=verification.instances,
        objects=tally.objects,
    )


def known_before(run: Path | None) -> tuple[str, ...]:
    """Names of the tasks that the library has, without what this very run has added: it may be resumed.

    Args:
        run: its folder; None: one that is still to be made.
    """
    memory = Memory()
    if run is None or not memory.is_there:
        return task_names()
    own = str(run.resolve())
    return tuple(name for name in task_names() if name in packaged_names() or memory.run_of(name) != own)


def _verify_anew(folder: Path, record: RunRecord) -> str:
    """The command that verifies a task on the objects and in the scenes of its run, as a shell takes it."""
    words = ["gensim2", "tasks", "add", str(folder)]
    for name in ("assets", "instances", "engine", "physics", "robot", "randomization"):
        told = record.arguments.get(name)
        if isinstance(told, str):  # a mixture of physics is a file's, whose name is not recorded
            words += [f"--{name}", told]
    return shlex.join(words)


def remember(run: Path, memory: Memory | None = None) -> Remembered:
    """Add the tasks that a run designed and kept to a library; to do so again changes nothing.

    Args:
        run: folder of ``gensim2 run-pipeline``.
        memory: default: the user's library.

    Raises:
        InputError: there is no such run, a file of it cannot be used, or the library cannot be written to.
    """
    memory = memory or Memory()
    if not memory.is_there:
        return Remembered(None, (), {})
    path = run / RUN_JSON
    if not path.is_file():
        raise InputError("holds no run", file=run, remedy="give the folder of a run-pipeline, or of a task.yaml")
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

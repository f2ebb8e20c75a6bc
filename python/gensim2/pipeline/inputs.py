"""What a user hands to the commands: all of it is checked before anything starts.

First what costs nothing (files, fields, names), then what needs one object of the class.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gensim2.errors import InputError, brief
from gensim2.objects import Library, open_library
from gensim2.planning.config import check_keypoints, solver_config
from gensim2.seeding import check_seed
from gensim2.tasks.library import load_config, load_config_file, load_task, load_task_file
from gensim2.tasks.spec import TaskSpec

#: Seconds; no job needs eleven days, and infinity is no time to wait.
LONGEST_TIME_LIMIT = 1e6


@dataclass(frozen=True)
class TaskInput:
    """A task that can be run: it is valid, its objects exist, and they have what its config names.

    Attributes:
        spec: the task.
        config: its solver config, as plain data.
        library: where its objects come from.
        instances: which of them, one word: ``"all"``, ``"train"``, ``"test"`` or an id.
    """

    spec: TaskSpec
    config: dict[str, Any]
    library: Library
    instances: str


def read_task_input(task: str, assets: str | Path | None, instances: str, seed: int) -> TaskInput:
    """Read and check a task.

    Args:
        task: name of a library task, or a folder that holds task.yaml and solver.yaml.
        assets: folder of objects, ``"builtin"``, or None for ``GENSIM2_ASSETS`` or else the built-in library.
        instances: ``all``, ``train``, ``test``, an id, or ``random``: one, drawn by ``seed``.
        seed: of the run.

    Raises:
        InputError: names the file and the field, or the argument.
    """
    seed = check_seed(seed)
    spec, config = task_and_config(task)
    folder = Path(task) if _is_folder(task) else None
    library = open_library(assets)
    if spec.asset_class not in library.classes():
        raise InputError(
            f"library {library.name} has no class {spec.asset_class!r}",
            file=folder / "task.yaml" if folder else None,
            field="asset_class",
            remedy=f"it has {', '.join(library.classes())}",
        )
    chosen = library.choose(spec.asset_class, instances, seed)
    config_file = folder / "solver.yaml" if folder else f"{spec.name}/solver.yaml"
    first = library.load(spec.asset_class, chosen[0])
    check_keypoints(solver_config(config, config_file), first.keypoints, first.joint.type, config_file)
    return TaskInput(spec, config, library, chosen[0] if instances == "random" else instances)


def task_and_config(task: str) -> tuple[TaskSpec, dict[str, Any]]:
    """Return the spec and the solver config of a library task, or of a folder with task.yaml and solver.yaml.

    Raises:
        InputError: there is no such task or folder, or a file in it cannot be used.
    """
    if not _is_folder(task):
        return load_task(task), load_config(task)
    folder = Path(task)
    spec, config = load_task_file(folder / "task.yaml"), load_config_file(folder / "solver.yaml")
    solver_config(config, folder / "solver.yaml")
    return spec, config


def _is_folder(task: str) -> bool:
    try:
        return bool(task) and Path(task).is_dir()
    except OSError as error:
        raise InputError(f"cannot read: {error.strerror}", file=task) from error


def check_workers(time_limit: float, jobs_per_worker: int) -> None:
    """Refuse options of worker processes that mean nothing.

    Raises:
        InputError: one is out of range.
    """
    if not 0 < time_limit <= LONGEST_TIME_LIMIT:
        raise InputError(f"must lie in 0..{LONGEST_TIME_LIMIT:g} s, is {time_limit}", field="time_limit")
    check_counts(jobs_per_worker=jobs_per_worker)


def check_counts(**values: int) -> None:
    """Refuse counts under one.

    Raises:
        InputError: names the first.
    """
    for name, value in values.items():
        if value < 1:
            raise InputError(f"must be at least 1, not {brief(value)}", field=name)

"""The task library: one folder of data a task, read through the package so that a wheel carries it.

``library/<Name>/task.yaml`` is a :class:`~gensim2.tasks.spec.TaskSpec`, ``library/<Name>/strategies/<name>.yaml`` a
way to do one of its steps. Folders of other tasks look the same; one of version 1 has a ``solver.yaml`` instead. Ways
that several tasks share lie in ``library/strategies/``: there a strategy is looked for that a task has not beside it.
"""

from __future__ import annotations

import difflib
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from gensim2.errors import InputError
from gensim2.tasks import version_1
from gensim2.tasks.parse import parse_task
from gensim2.tasks.spec import TaskSpec
from gensim2.yaml_files import parse_yaml, read_yaml

TASK_FILE = "task.yaml"
STRATEGIES = "strategies"

Strategy = dict[str, Any]
"""A way to do a step, as plain data: a solver config in the paper's language, or a rule for a grasp."""


def _folder() -> Traversable:
    return files("gensim2.tasks") / "library"


@cache
def task_names() -> tuple[str, ...]:
    """Names of the tasks in the library, sorted."""
    return tuple(sorted(entry.name for entry in _folder().iterdir() if (entry / TASK_FILE).is_file()))


def task_folder(name: str) -> Traversable:
    """The folder of a library task.

    Raises:
        InputError: there is no such task; names near matches.
    """
    if name in task_names():
        return _folder() / name
    by_lower = {known.lower(): known for known in task_names()}
    near = [by_lower[match] for match in difflib.get_close_matches(name.lower(), by_lower, n=3, cutoff=0.5)]
    remedy = f"did you mean {', '.join(near)}?" if near else f"known: {', '.join(task_names())}"
    raise InputError(f"unknown task {name!r}", remedy=remedy)


@cache
def load_task(name: str) -> TaskSpec:
    """The spec of a library task.

    Raises:
        InputError: there is no such task; names near matches.
    """
    source = task_folder(name) / TASK_FILE
    task = parse_task(parse_yaml(source.read_bytes(), str(source)), str(source))
    if task.name != name:
        raise InputError(f"is {task.name!r} in the folder {name!r}", file=str(source), field="name")
    return task


def load_strategies(name: str) -> dict[str, Strategy]:
    """The strategies of a library task, by name: those that its steps name, in that order.

    Raises:
        InputError: there is no such task, or a strategy's file is missing.
    """
    return {strategy: _read(file) for strategy, file in strategy_files(task_folder(name), load_task(name)).items()}


def load_task_file(path: Path) -> TaskSpec:
    """The spec in a YAML (or JSON) file, or in the ``task.yaml`` of a folder.

    Raises:
        InputError: the file cannot be read, is not YAML, or a field is unknown, missing or out of range.
    """
    source = path / TASK_FILE if path.is_dir() else path
    return parse_task(read_yaml(source), str(source))


def load_strategies_beside(path: Path, task: TaskSpec) -> dict[str, Strategy]:
    """The strategies of a task that was read from a file or a folder, by name: those that its steps name.

    Raises:
        InputError: a strategy's file is missing, cannot be read, or holds NaN or infinity.
    """
    folder = path if path.is_dir() else path.parent
    return {name: _read(file) for name, file in strategy_files(folder, task).items()}


def load_strategy_file(path: Path) -> Strategy:
    """One strategy in a YAML (or JSON) file; numbers are finite.

    Raises:
        InputError: the file cannot be read, is not YAML, or holds NaN or infinity.
    """
    return read_yaml(path)


def strategies_of(task: TaskSpec) -> tuple[str, ...]:
    """Names of all strategies of a task, in the order in which its steps name them."""
    return tuple(dict.fromkeys(name for step in task.steps for name in step.strategies))


def strategy_files(folder: Traversable, task: TaskSpec) -> dict[str, Traversable]:
    """The files of a task's strategies, by name: beside the task, or else one that the library's tasks share.

    Args:
        folder: of the task; ``task_folder`` gives that of a library task.

    Raises:
        InputError: there is no such file.
    """
    found: dict[str, Traversable] = {}
    for name in strategies_of(task):
        places = _places(folder, name)
        file = next((file for file in places if file.is_file()), None)
        if file is None:
            there = sorted({*_names_in(folder / STRATEGIES), *_names_in(_folder() / STRATEGIES)})
            near = difflib.get_close_matches(name, there, n=1)
            remedy = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(there) or 'none'}"
            raise InputError(f"a step names a strategy {name!r} without a file", file=str(places[0]), remedy=remedy)
        found[name] = file
    return found


def _places(folder: Traversable, name: str) -> list[Traversable]:
    """Where the file of a strategy may lie, first its own task's."""
    former = [folder / f"{name}.yaml"] if name == version_1.STRATEGY else []
    return [folder / STRATEGIES / f"{name}.yaml", *former, _folder() / STRATEGIES / f"{name}.yaml"]


def _read(file: Traversable) -> Strategy:
    return load_strategy_file(file) if isinstance(file, Path) else parse_yaml(file.read_bytes(), str(file))


def _names_in(folder: Traversable) -> list[str]:
    entries = folder.iterdir() if folder.is_dir() else ()
    return sorted(entry.name.removesuffix(".yaml") for entry in entries if entry.name.endswith(".yaml"))

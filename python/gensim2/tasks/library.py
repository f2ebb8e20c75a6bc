"""Read the task library. The library has one folder for each task, and the folders are in three locations.

- ``library/`` in this package contains the tasks of the paper.
- ``designed/`` in this package contains tasks that language models (designers) made with generated objects.
- The user's folder (:func:`user_library`) contains tasks that the user's runs have added.

A task's folder is named after the task. Its file ``task.yaml`` is a :class:`~gensim2.tasks.spec.TaskSpec`. Each file
``strategies/<name>.yaml`` in the folder describes a strategy: one method to plan a step. Tasks of the package can also
use strategies of a shared folder ``strategies/``, which lies beside the task folders. A strategy is read from the
shared folder if it has no file in the task's folder. Folders in the older schema version 1 have a single file
``solver.yaml`` instead of strategies.
"""

from __future__ import annotations

import contextlib
import difflib
import os
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from platformdirs import user_data_path

from gensim2.core.errors import InputError, near
from gensim2.core.files import user_folder
from gensim2.core.foreign.archive import open_archive, read_member
from gensim2.core.yaml_files import MAX_BYTES, parse_yaml, read_yaml
from gensim2.tasks import version_1
from gensim2.tasks.parse import parse_task
from gensim2.tasks.spec import DESIGNED, TaskSpec

TASK_FILE = "task.yaml"
STRATEGIES = "strategies"

StrategyData = dict[str, Any]
"""A strategy for a step, as plain data: a solver config in the paper's language, or a rule for a grasp."""


PAPER = "paper"
"""Origin of the tasks in the paper's tables."""

LIBRARY_VARIABLE, NO_LIBRARY = "GENSIM2_LIBRARY", "none"


_chosen: ContextVar[str | None] = ContextVar("library", default=None)


@contextlib.contextmanager
def using_library(folder: str) -> Iterator[None]:
    """Use the given user library, instead of the default user library, within a ``with`` block.

    Args:
        folder: path of the library, a folder or a ``.zip`` file, or ``none`` for no user library.

    Raises:
        InputError: the path is neither a folder nor a ``.zip`` file.
    """
    if folder != NO_LIBRARY:
        _require_library(Path(folder))
    token = _chosen.set(folder)
    try:
        yield
    finally:
        _chosen.reset(token)


def user_library() -> Path | None:
    """Return the path of the user's task library. A path that was set with :func:`using_library` comes first, and the
    environment variable ``GENSIM2_LIBRARY`` second. Without both, the path is a folder in the user's data folder.

    The path need not exist. The function returns None if the user has disabled the library with the value ``none``.
    """
    chosen = _chosen.get()
    if chosen:
        return None if chosen == NO_LIBRARY else Path(chosen)
    given = os.environ.get(LIBRARY_VARIABLE)
    return None if given == NO_LIBRARY else user_folder(LIBRARY_VARIABLE, lambda: user_data_path("gensim2") / "tasks")


def _user_shelf() -> Traversable | None:
    """Return the user's library, a folder or an exported archive, or None. Raise InputError for another file."""
    path = user_library()
    if path is None or path.is_dir() or not path.exists():
        return path
    _require_library(path)
    return open_archive(path)


def _require_library(path: Path) -> None:
    if path.exists() and not path.is_dir() and path.suffix != ".zip":
        wrong = "the task library must be a folder or a .zip file"
        raise InputError(wrong, file=path, remedy="give a library that gensim2 tasks export has written")


def _suite() -> Traversable:
    return files("gensim2.tasks") / "library"


def _designed() -> Traversable:
    return files("gensim2.tasks") / "designed"


def task_names(origin: str | None = None) -> tuple[str, ...]:
    """Return the names of the tasks in the library, sorted.

    Args:
        origin: ``"paper"`` for the paper's suite, or a designer's name; None: all tasks.

    Raises:
        InputError: no task has this origin, or a task cannot be read.

    Example:
        ```python
        print(gensim2.task_names("paper"))
        ```
    """
    if origin is None:
        return tuple(sorted({*packaged_names(), *names_in(_user_shelf())}))
    if origin == PAPER:
        return _names_on_shelf(_suite)
    found = tuple(name for name in task_names() if origin_of(load_task(name)) == origin)
    if not found:
        known = sorted({str(origin_of(load_task(name))) for name in task_names()})
        wrong = f"no task of the library has the origin {origin!r}"
        raise InputError(wrong, field="origin", remedy=near(origin, known))
    return found


def packaged_names() -> tuple[str, ...]:
    """Return the names of the tasks shipped with the package, sorted."""
    return tuple(sorted({*_names_on_shelf(_suite), *_names_on_shelf(_designed)}))


def origin_of(task: TaskSpec) -> str | None:
    """Return the origin of a task (``paper`` or the name of a designer); None if unknown."""
    return None if task.provenance is None else task.provenance.origin


def task_folder(name: str) -> Traversable:
    """Return the folder of a library task; tasks of the package take precedence over the user's library.

    Raises:
        InputError: no task has this name; the message suggests similar names.
    """
    for shelf in (_suite, _designed):
        if name in _names_on_shelf(shelf):
            return shelf() / name
    own = _user_shelf()
    if own is not None and name in names_in(own):
        return own / name
    by_lower = {known.lower(): known for known in task_names()}
    alike = [by_lower[match] for match in difflib.get_close_matches(name.lower(), by_lower, n=3, cutoff=0.5)]
    remedy = f"did you mean {', '.join(alike)}?" if alike else "gensim2 tasks list names all"
    raise InputError(f"unknown task {name!r}", remedy=remedy)


def load_task(name: str) -> TaskSpec:
    """Load the spec of a library task.

    Args:
        name: name of the task, such as ``"OpenDrawer"``.

    Raises:
        InputError: no task has this name, or its file cannot be used.

    Example:
        ```python
        task = gensim2.load_task("OpenDrawer")
        print(task.description, [step.name for step in task.steps])
        ```
    """
    return _packaged_task(name) if name in packaged_names() else _read_task(task_folder(name), name)


@cache
def _packaged_task(name: str) -> TaskSpec:
    return _read_task(task_folder(name), name)


def _read_task(folder: Traversable, name: str) -> TaskSpec:
    source = folder / TASK_FILE
    task = parse_task(_read(source), str(source))
    if task.name != name:
        wrong = f"the task must have the same name as its folder, {name!r}, but its name is {task.name!r}"
        raise InputError(wrong, file=str(source), field="name")
    return task


@cache
def _names_on_shelf(shelf: Callable[[], Traversable]) -> tuple[str, ...]:
    """Return the names of the tasks in a folder of the package.

    The names are cached, because packages do not change.
    """
    return names_in(shelf())


def names_in(shelf: Traversable | None) -> tuple[str, ...]:
    """Return the names of the tasks in a folder, sorted."""
    entries = shelf.iterdir() if shelf is not None and shelf.is_dir() else ()
    return tuple(sorted(entry.name for entry in entries if entry.name[:1] != "." and (entry / TASK_FILE).is_file()))


def load_strategies(name: str) -> dict[str, StrategyData]:
    """Load the strategies of a library task.

    Args:
        name: name of the task, such as ``"OpenDrawer"``.

    Returns:
        Strategies as JSON data, by name, in the order in which the task's steps name them.

    Raises:
        InputError: no task has this name, or a strategy's file is missing.

    Example:
        ```python
        strategies = gensim2.load_strategies("OpenDrawer")
        print(list(strategies))
        ```
    """
    return {strategy: _read(file) for strategy, file in strategy_files(task_folder(name), load_task(name)).items()}


@cache
def shared_strategy(name: str) -> StrategyData:
    """Return a strategy that tasks of the package share; the caller must not modify the result.

    Raises:
        InputError: no shared strategy has this name.
    """
    file = next((file for file in (shelf / f"{name}.yaml" for shelf in _shared()) if file.is_file()), None)
    if file is None:
        raise InputError(f"there is no shared strategy {name!r}", field="strategies")
    return _read(file)


def load_task_file(path: Path) -> TaskSpec:
    """Load the spec in a YAML or JSON file, or in the ``task.yaml`` of a folder.

    Raises:
        InputError: the file cannot be read, is not YAML, or a field is unknown, missing or out of range.
    """
    source = path / TASK_FILE if path.is_dir() else path
    if path.is_dir() and not os.path.lexists(source):
        remedy = f"give a folder with {TASK_FILE} and strategies/, or a task by its name"
        raise InputError("is not there", file=source, remedy=remedy)
    return parse_task(read_yaml(source), str(source))


def load_strategies_beside(path: Path, task: TaskSpec) -> dict[str, StrategyData]:
    """Load the strategies of a task that was read from the file or folder ``path``. Return them by name.

    Raises:
        InputError: a strategy's file is missing or unreadable, or contains NaN or infinity.
    """
    folder = path if path.is_dir() else path.parent
    return {name: _read(file) for name, file in strategy_files(folder, task).items()}


def strategies_of(task: TaskSpec) -> tuple[str, ...]:
    """Return the names of all strategies of a task, in the order in which its steps name them."""
    return tuple(dict.fromkeys(name for step in task.steps for name in step.strategies))


def strategy_files(folder: Traversable, task: TaskSpec) -> dict[str, Traversable]:
    """Return the file of each strategy of a task, by the strategy's name. The file is in the task's folder, or else in
    the folder of shared strategies.

    Args:
        folder: folder of the task (:func:`task_folder` for a library task).

    Raises:
        InputError: a file is missing.
    """
    found: dict[str, Traversable] = {}
    for name in strategies_of(task):
        places = _places(folder, name)
        file = next((file for file in places if file.is_file()), None)
        if file is None and name == DESIGNED:
            step = next(step.name for step in task.steps if name in step.strategies)
            raise InputError(
                "the step has no strategy yet",
                file=str(folder / TASK_FILE),
                field=f"steps.{step}.strategies",
                remedy=f"`gensim2 design {folder}` finds one, or name a strategy that you wrote",
            )
        if file is None:
            shared = (name for shelf in _shared() for name in _files_in(shelf))
            there = sorted({*_files_in(folder / STRATEGIES), *shared})
            what = f"a step names a strategy {name!r} without a file"
            raise InputError(what, file=str(places[0]), remedy=near(name, there))
        found[name] = file
    return found


def _places(folder: Traversable, name: str) -> list[Traversable]:
    """Return the possible paths of a strategy's file. The path in the task's folder comes first."""
    former = [folder / f"{name}.yaml"] if name == version_1.STRATEGY else []
    return [folder / STRATEGIES / f"{name}.yaml", *former, *(shelf / f"{name}.yaml" for shelf in _shared())]


def _shared() -> tuple[Traversable, ...]:
    return _suite() / STRATEGIES, _designed() / STRATEGIES


def _read(file: Traversable) -> dict[str, Any]:
    """Read a YAML file from the package, from a folder or from a zip archive."""
    if isinstance(file, Path):
        return read_yaml(file)
    return parse_yaml(read_member(file, MAX_BYTES + 1), str(file))


def _files_in(folder: Traversable) -> list[str]:
    entries = folder.iterdir() if folder.is_dir() else ()
    return sorted(entry.name.removesuffix(".yaml") for entry in entries if entry.name.endswith(".yaml"))

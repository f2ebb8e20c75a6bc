"""The task library: one folder of data a task, on three shelves.

``library/`` in the package holds the paper's suite, ``designed/`` beside it what designers made of generated objects,
and a folder of the user (:func:`user_library`) what their own runs kept. On each, ``<Name>/task.yaml`` is a
:class:`~gensim2.tasks.spec.TaskSpec`, ``<Name>/strategies/<name>.yaml`` a way to do one of its steps. Folders of other
tasks look the same; one of version 1 has a ``solver.yaml`` instead. Ways that several tasks share lie in
``strategies/`` on the package's shelves: there a strategy is looked for that a task has not beside it.
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
from gensim2.tasks.spec import TaskSpec

TASK_FILE = "task.yaml"
STRATEGIES = "strategies"

StrategyData = dict[str, Any]
"""A way to do a step, as plain data: a solver config in the paper's language, or a rule for a grasp."""


PAPER = "paper"
"""Origin of the suite: what the paper's tables list."""

LIBRARY_VARIABLE, NO_LIBRARY = "GENSIM2_LIBRARY", "none"


_chosen: ContextVar[str | None] = ContextVar("library", default=None)


@contextlib.contextmanager
def using_library(folder: str) -> Iterator[None]:
    """Have a folder, an archive or ``none`` for the user's own shelf inside a block."""
    token = _chosen.set(folder)
    try:
        yield
    finally:
        _chosen.reset(token)


def user_library() -> Path | None:
    """The user's own shelf: of :func:`using_library`, else ``$GENSIM2_LIBRARY``, else a folder among the user's data.

    It need not exist. None for the word ``none``: nothing is read there and nothing kept.
    """
    chosen = _chosen.get()
    if chosen:
        return None if chosen == NO_LIBRARY else Path(chosen)
    given = os.environ.get(LIBRARY_VARIABLE)
    return None if given == NO_LIBRARY else user_folder(LIBRARY_VARIABLE, lambda: user_data_path("gensim2") / "tasks")


def _user_shelf() -> Traversable | None:
    """The user's own shelf, if any; an archive that ``gensim2 tasks export`` wrote is one that can be read.

    Raises:
        InputError: it is no archive.
    """
    path = user_library()
    if path is None or path.suffix != ".zip" or not path.is_file():
        return path
    return open_archive(path)


def _suite() -> Traversable:
    return files("gensim2.tasks") / "library"


def _designed() -> Traversable:
    return files("gensim2.tasks") / "designed"


def task_names(origin: str | None = None) -> tuple[str, ...]:
    """Return the names of the tasks in the library, sorted.

    Args:
        origin: proposer of the tasks: ``"paper"`` for the suite, else a designer's name; None: all.

    Raises:
        InputError: no task has that origin (names the origins that there are), or a task cannot be read.
    """
    if origin is None:
        return tuple(sorted({*packaged_names(), *names_in(_user_shelf())}))
    if origin == PAPER:
        return _names_on_shelf(_suite)
    found = tuple(name for name in task_names() if origin_of(load_task(name)) == origin)
    if not found:
        known = sorted({str(origin_of(load_task(name))) for name in task_names()})
        raise InputError(f"no task of the library is of {origin!r}", field="origin", remedy=near(origin, known))
    return found


def packaged_names() -> tuple[str, ...]:
    """Names of the tasks that travel with the package, sorted."""
    return tuple(sorted({*_names_on_shelf(_suite), *_names_on_shelf(_designed)}))


def origin_of(task: TaskSpec) -> str | None:
    """Return who proposed a task; None where that is not known."""
    return None if task.provenance is None else task.provenance.origin


def task_folder(name: str) -> Traversable:
    """The folder of a library task; where two shelves have the name, the package's.

    Raises:
        InputError: there is no such task; names near matches.
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
        name: of the task, e.g. ``"OpenDrawer"``.

    Returns:
        Objects, steps and goal of the task.

    Raises:
        InputError: there is no such task (names near matches), or its file cannot be used.
    """
    return _packaged_task(name) if name in packaged_names() else _read_task(task_folder(name), name)


@cache
def _packaged_task(name: str) -> TaskSpec:
    return _read_task(task_folder(name), name)


def _read_task(folder: Traversable, name: str) -> TaskSpec:
    source = folder / TASK_FILE
    task = parse_task(_read(source), str(source))
    if task.name != name:
        raise InputError(f"is {task.name!r} in the folder {name!r}", file=str(source), field="name")
    return task


@cache
def _names_on_shelf(shelf: Callable[[], Traversable]) -> tuple[str, ...]:
    """Of a shelf of the package: it does not change."""
    return names_in(shelf())


def names_in(shelf: Traversable | None) -> tuple[str, ...]:
    """Names of the tasks that lie in a folder, sorted."""
    entries = shelf.iterdir() if shelf is not None and shelf.is_dir() else ()
    return tuple(sorted(entry.name for entry in entries if entry.name[:1] != "." and (entry / TASK_FILE).is_file()))


def load_strategies(name: str) -> dict[str, StrategyData]:
    """Load the strategies of a library task.

    Args:
        name: of the task, e.g. ``"OpenDrawer"``.

    Returns:
        Strategies as plain data, by name: those that the task's steps name, in that order.

    Raises:
        InputError: there is no such task, or a strategy's file is missing.
    """
    return {strategy: _read(file) for strategy, file in strategy_files(task_folder(name), load_task(name)).items()}


@cache
def shared_strategy(name: str) -> StrategyData:
    """One of the ways that tasks of the package share; not to be changed in place.

    Raises:
        InputError: there is none of that name.
    """
    file = next((file for file in (shelf / f"{name}.yaml" for shelf in _shared()) if file.is_file()), None)
    if file is None:
        raise InputError(f"no shared strategy {name!r}", field="strategies")
    return _read(file)


def load_task_file(path: Path) -> TaskSpec:
    """The spec in a YAML (or JSON) file, or in the ``task.yaml`` of a folder.

    Raises:
        InputError: the file cannot be read, is not YAML, or a field is unknown, missing or out of range.
    """
    source = path / TASK_FILE if path.is_dir() else path
    if path.is_dir() and not os.path.lexists(source):
        remedy = f"give a folder with {TASK_FILE} and strategies/, or a task by its name"
        raise InputError("is not there", file=source, remedy=remedy)
    return parse_task(read_yaml(source), str(source))


def load_strategies_beside(path: Path, task: TaskSpec) -> dict[str, StrategyData]:
    """The strategies of a task that was read from a file or a folder, by name: those that its steps name.

    Raises:
        InputError: a strategy's file is missing, cannot be read, or holds NaN or infinity.
    """
    folder = path if path.is_dir() else path.parent
    return {name: _read(file) for name, file in strategy_files(folder, task).items()}


def load_strategy_file(path: Path) -> StrategyData:
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
            shared = (name for shelf in _shared() for name in _files_in(shelf))
            there = sorted({*_files_in(folder / STRATEGIES), *shared})
            what = f"a step names a strategy {name!r} without a file"
            raise InputError(what, file=str(places[0]), remedy=near(name, there))
        found[name] = file
    return found


def _places(folder: Traversable, name: str) -> list[Traversable]:
    """Return the paths at which the file of a strategy may lie, first its own task's."""
    former = [folder / f"{name}.yaml"] if name == version_1.STRATEGY else []
    return [folder / STRATEGIES / f"{name}.yaml", *former, *(shelf / f"{name}.yaml" for shelf in _shared())]


def _shared() -> tuple[Traversable, ...]:
    return _suite() / STRATEGIES, _designed() / STRATEGIES


def _read(file: Traversable) -> dict[str, Any]:
    """The fields of a file of the package, of a folder or of an archive."""
    if isinstance(file, Path):
        return read_yaml(file)
    return parse_yaml(read_member(file, MAX_BYTES + 1), str(file))


def _files_in(folder: Traversable) -> list[str]:
    entries = folder.iterdir() if folder.is_dir() else ()
    return sorted(entry.name.removesuffix(".yaml") for entry in entries if entry.name.endswith(".yaml"))

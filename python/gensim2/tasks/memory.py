"""The user's own library: tasks that were verified, each a folder that is there whole or not at all.

Beside ``task.yaml`` and all its strategies a folder holds ``added.json``: when, and by which run. Whoever adds or
removes holds the library's lock; whoever reads needs none, as folders come and go by one renaming each.
"""

from __future__ import annotations

import contextlib
import importlib.metadata
import json
import os
import secrets
import shutil
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from filelock import FileLock

from gensim2.core.errors import InputError, near
from gensim2.core.files import sync_folder, write_json
from gensim2.core.yaml_files import read_yaml
from gensim2.tasks.exporting import write_task
from gensim2.tasks.library import (
    PAPER,
    TASK_FILE,
    StrategyData,
    load_strategies_beside,
    load_task,
    load_task_file,
    names_in,
    packaged_names,
    strategies_of,
    task_names,
    user_library,
)
from gensim2.tasks.likeness import first_alike
from gensim2.tasks.spec import TaskSpec, Verified

ADDED_FILE = "added.json"
LOCK_FILE = ".lock"
_LEFT = ".tmp"

LEAST_EPISODES = 20
"""Fresh episodes under which nothing counts as verified."""
LEAST_SHARE = 0.6
"""Share of them that must hold."""


class UnverifiedTaskError(InputError):
    """A task was to be added that was not verified, or that did not hold."""


class KnownTaskError(InputError):
    """A task was to be added that the library has, by its name or in other words.

    Attributes:
        known: name of the task that it has.
    """

    def __init__(self, task: TaskSpec, known: str, why: str) -> None:
        super().__init__(f"{task.name} is not new: {known} {why}", field="name")
        self.known = known


class Memory:
    """The user's library.

    Args:
        folder: where it lies; default :func:`~gensim2.tasks.library.user_library`. It need not exist.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = user_library() if folder is None else folder

    @property
    def folder(self) -> Path:
        """Folder of the library.

        Raises:
            InputError: the user wants none, or it is an archive.
        """
        if self._folder is None:
            raise InputError("there is no library of your own", field="library", remedy="give a folder, not none")
        if self._folder.is_file():
            raise InputError("is no folder: an archive is only read", file=self._folder, field="library")
        return self._folder

    @property
    def is_there(self) -> bool:
        """Whether there is one; it may be empty."""
        return self._folder is not None

    def names(self) -> tuple[str, ...]:
        """Names of its tasks, sorted."""
        return names_in(self._folder)

    def run_of(self, name: str) -> str | None:
        """Folder of the run that a task comes from; None where it is unknown, or it is no task of this library.

        Raises:
            InputError: what was written down when it was added cannot be read.
        """
        if name not in self.names():
            return None
        path = self.folder / name / ADDED_FILE
        if not path.is_file():
            return None
        run = read_yaml(path).get("run")
        return run if isinstance(run, str) else None

    def add(
        self,
        task: TaskSpec,
        strategies: Mapping[str, StrategyData],
        verification: Verified,
        *,
        run: str | None = None,
    ) -> Path:
        """Keep a task that was verified; to add the same again changes nothing.

        Args:
            task: with the provenance that says who proposed it.
            strategies: by name; all that its steps name.
            verification: on scenes and objects that its design did not see; it becomes part of the provenance.
            run: folder of the run that it comes from.

        Returns:
            Its folder.

        Raises:
            UnverifiedTaskError: too few episodes, or too few that held.
            KnownTaskError: the library, or the package, has this name or such a task.
            InputError: it does not say who proposed it, a strategy is missing, or the folder cannot be written to.
        """
        _check_verified(task, verification)
        kept = _with_verification(task, verification)
        missing = [name for name in strategies_of(kept) if name not in strategies]
        if missing:
            raise InputError(f"{task.name}: the strategy {missing[0]!r} is not given", field="strategies")
        ways = {name: dict(strategies[name]) for name in strategies_of(kept)}
        with self._locked():
            if self._has(kept, ways):
                return self.folder / task.name
            self._check_new(kept)
            with self._making(task.name) as made:
                write_task(made, kept, ways)
                write_json(made / ADDED_FILE, _note(run))
        return self.folder / task.name

    def check_new(self, task: TaskSpec, strategies: Mapping[str, StrategyData]) -> None:
        """Refuse a task that could not be added whatever its verification says; the very same is no such task.

        Raises:
            KnownTaskError: the library, or the package, has this name or such a task.
        """
        if not self._has(task, {name: dict(strategies[name]) for name in strategies_of(task)}):
            self._check_new(task)

    def remove(self, *names: str) -> None:
        """Remove tasks: all of them or, where one cannot be, none.

        Raises:
            InputError: one is not among the user's own, or cannot be removed.
        """
        own = names_in(self.folder)
        for name in names:
            if name in own:
                continue
            if name in packaged_names():
                raise InputError(f"{name} is part of the package", remedy="only your own tasks can be removed")
            raise InputError(f"there is no task {name!r} in {self.folder}", remedy=near(name, own))
        with self._locked():
            for name in dict.fromkeys(names):
                self._remove(name)

    def _remove(self, name: str) -> None:
        gone = self.folder / _temporary(name)
        try:
            (self.folder / name).rename(gone)
        except FileNotFoundError:
            return  # another process was quicker
        sync_folder(self.folder)
        shutil.rmtree(gone)

    def _has(self, task: TaskSpec, strategies: Mapping[str, StrategyData]) -> bool:
        """Whether just this task stands here, verified at whatever time."""
        if task.name not in self.names():
            return False
        found = read_task(self.folder / task.name)
        return _bare(found[0]) == _bare(task) and found[1] == json.loads(json.dumps(strategies))

    def _check_new(self, task: TaskSpec) -> None:
        known = {*task_names(), *self.names()}
        if task.name in known:
            raise KnownTaskError(task, task.name, "is taken")
        others = [_spec_of(self.folder, name) for name in sorted(known)]
        if (found := first_alike(task, others)) is not None:
            raise KnownTaskError(task, found[0].name, found[1])

    @contextlib.contextmanager
    def _making(self, name: str) -> Iterator[Path]:
        """Give a folder to fill; it gets its name when the block ends."""
        made = self.folder / _temporary(name)
        try:
            made.mkdir()
            yield made
            sync_folder(made)
            made.rename(self.folder / name)
            sync_folder(self.folder)
        finally:
            shutil.rmtree(made, ignore_errors=True)

    @contextlib.contextmanager
    def _locked(self) -> Iterator[None]:
        """Be the only one who writes here; the lock ends with the process, and what a killed one left goes.

        Raises:
            InputError: the folder cannot be written to.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with FileLock(self.folder / LOCK_FILE):
                for left in self.folder.glob(f".*{_LEFT}"):
                    shutil.rmtree(left)
                yield
        except OSError as error:
            remedy = "choose another folder with --library or GENSIM2_LIBRARY"
            raise InputError(f"cannot write: {error.strerror}", file=self.folder, remedy=remedy) from error


def read_task(folder: Path) -> tuple[TaskSpec, dict[str, StrategyData]]:
    """The spec and the strategies in a folder.

    Raises:
        InputError: a file is missing or cannot be used.
    """
    task = load_task_file(folder)
    return task, load_strategies_beside(folder, task)


def _check_verified(task: TaskSpec, verification: Verified) -> None:
    told = f"{task.name}: {verification.held} of {verification.episodes} fresh episodes held"
    if verification.episodes < LEAST_EPISODES:
        raise UnverifiedTaskError(told, remedy=f"verify it with {LEAST_EPISODES} or more")
    if verification.share < LEAST_SHARE:
        raise UnverifiedTaskError(f"{told}, less than {LEAST_SHARE:g} of them")


def _with_verification(task: TaskSpec, verification: Verified) -> TaskSpec:
    if task.provenance is None or task.provenance.origin == PAPER:
        raise InputError(f"{task.name}: does not say who proposed it", field="provenance.origin")
    provenance = task.provenance.model_copy(update={"verification": verification})
    return task.model_copy(update={"provenance": provenance})


def _bare(task: TaskSpec) -> TaskSpec:
    return task.model_copy(update={"provenance": None})


def _spec_of(folder: Path, name: str) -> TaskSpec:
    """Of a task of the package, of the user's library, or of another folder that is being written to."""
    own = folder / name
    return read_task(own)[0] if (own / TASK_FILE).is_file() else load_task(name)


def _note(run: str | None) -> dict[str, Any]:
    return {
        "schema_version": 1,
        "added": time.strftime("%Y-%m-%dT%H:%M:%S%z"),
        "gensim2": importlib.metadata.version("gensim2"),
        "run": None if run is None else os.fspath(run),
    }


def _temporary(name: str) -> str:
    return f".{name}.{secrets.token_hex(8)}{_LEFT}"

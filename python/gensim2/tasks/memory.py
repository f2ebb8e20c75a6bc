"""Read and change the user's task library. An interrupted program never leaves an incomplete task in the library.

Besides ``task.yaml`` and the strategies, a task's folder contains ``added.json`` with the time and the run that added
the task. A program locks the library while it changes the library. Readers need no lock, because a complete folder is
added or removed in one operation, by renaming it.
"""

from __future__ import annotations

import contextlib
import importlib.metadata
import json
import os
import secrets
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from filelock import FileLock

from gensim2.core.errors import InputError, near
from gensim2.core.files import sync_folder, write_json
from gensim2.core.progress import now
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
"""Minimum number of fresh episodes of a verification."""
LEAST_SHARE = 0.6
"""Minimum success rate of a verification."""


class UnverifiedTaskError(InputError):
    """A task cannot be added because its verification did not succeed."""


class KnownTaskError(InputError):
    """A task cannot be added because the library already has a task of the same name or meaning.

    Attributes:
        known: name of the existing task.
    """

    def __init__(self, task: TaskSpec, known: str, why: str) -> None:
        super().__init__(f"{task.name} is not new: {known} {why}", field="name")
        self.known = known


class Memory:
    """The user's task library.

    Args:
        folder: folder of the library, which need not exist; default: :func:`~gensim2.tasks.library.user_library`.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = user_library() if folder is None else folder

    @property
    def folder(self) -> Path:
        """Folder of the library.

        Raises:
            InputError: the user disabled the library, or it is an archive.
        """
        if self._folder is None:
            raise InputError("the user library is disabled", field="library", remedy="give a folder instead of 'none'")
        if self._folder.is_file():
            wrong = "the library is an archive, which is read-only; give a folder"
            raise InputError(wrong, file=self._folder, field="library")
        return self._folder

    @property
    def is_there(self) -> bool:
        """Whether the user's library exists, even if empty."""
        return self._folder is not None

    def names(self) -> tuple[str, ...]:
        """Return the names of the library's tasks, sorted."""
        return names_in(self._folder)

    def run_of(self, name: str) -> str | None:
        """Return the folder of the run that made a task; None if unknown, or if the library lacks the task.

        Raises:
            InputError: the task's ``added.json`` cannot be read.
        """
        if name not in self.names():
            return None
        path = self.folder / name / ADDED_FILE
        if not path.is_file():
            return None
        run = read_yaml(path).get("run")
        return run if isinstance(run, str) else None

    def add(
        self, task: TaskSpec, strategies: Mapping[str, StrategyData], verification: Verified, *, run: str | None = None
    ) -> Path:
        """Add a verified task; adding the same task again changes nothing.

        Args:
            task: task with a provenance that names its origin.
            strategies: all strategies that the steps of the task name, by name.
            verification: result of the verification, on scenes and objects that the design did not use. It is stored in
                the task's provenance.
            run: folder of the run that made the task.

        Returns:
            Folder of the task.

        Raises:
            UnverifiedTaskError: the verification has too few episodes or too low a success rate.
            KnownTaskError: the library or the package has a task of the same name or meaning.
            InputError: the origin or a strategy is missing, or the folder cannot be written to.
        """
        _check_verified(task, verification)
        kept = _with_verification(task, verification)
        missing = [name for name in strategies_of(kept) if name not in strategies]
        if missing:
            wrong = f"the task {task.name} uses the strategy {missing[0]!r}, which was not given"
            raise InputError(wrong, field="strategies")
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
        """Check that the library would accept a task after its verification. A task that is already stored with the
        same content passes, because adding it again changes nothing.

        Raises:
            KnownTaskError: the library or the package has a different task of the same name, or a task of the same
                meaning.
        """
        if not self._has(task, {name: dict(strategies[name]) for name in strategies_of(task)}):
            self._check_new(task)

    def remove(self, *names: str) -> None:
        """Remove all tasks of the given names; if one of them cannot be removed, remove none.

        Raises:
            InputError: a task is not in the user's library or cannot be removed.
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
            return  # another process has already removed the folder
        sync_folder(self.folder)
        shutil.rmtree(gone)

    def _has(self, task: TaskSpec, strategies: Mapping[str, StrategyData]) -> bool:
        """Return whether the library has an identical task, regardless of its verification."""
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
        """Yield a temporary folder. After the block it becomes the folder of the task; after an error it is deleted."""
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
        """Lock the library during a block, without temporary folders of killed processes."""
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
    """Read the spec and the strategies in a folder.

    Raises:
        InputError: a file is missing or cannot be used.
    """
    task = load_task_file(folder)
    return task, load_strategies_beside(folder, task)


def _check_verified(task: TaskSpec, verification: Verified) -> None:
    told = f"{task.name}: {verification.held} of {verification.episodes} fresh episodes succeeded"
    if verification.episodes < LEAST_EPISODES:
        raise UnverifiedTaskError(told, remedy=f"verify it with {LEAST_EPISODES} or more")
    if verification.share < LEAST_SHARE:
        raise UnverifiedTaskError(f"{told}, but the success rate must be at least {LEAST_SHARE:g}")


def _with_verification(task: TaskSpec, verification: Verified) -> TaskSpec:
    if task.provenance is None or task.provenance.origin == PAPER:
        wrong = f"the task {task.name} must have an origin other than {PAPER!r}"
        raise InputError(wrong, field="provenance.origin")
    provenance = task.provenance.model_copy(update={"verification": verification})
    return task.model_copy(update={"provenance": provenance})


def _bare(task: TaskSpec) -> TaskSpec:
    return task.model_copy(update={"provenance": None})


def _spec_of(folder: Path, name: str) -> TaskSpec:
    """Read a task of the package, of the user's library, or of another folder."""
    own = folder / name
    return read_task(own)[0] if (own / TASK_FILE).is_file() else load_task(name)


def _note(run: str | None) -> dict[str, Any]:
    return {
        "schema_version": 1,
        "added": now(),
        "gensim2": importlib.metadata.version("gensim2"),
        "run": None if run is None else os.fspath(run),
    }


def _temporary(name: str) -> str:
    return f".{name}.{secrets.token_hex(8)}{_LEFT}"

"""Manage a folder to which only one run at a time may write; a later call can resume the run."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar, Generic, Self, TypeVar

from filelock import FileLock, Timeout
from pydantic import BaseModel, ConfigDict

from gensim2.core.errors import InputError, WriteError
from gensim2.core.files import remove_temporaries, write_json
from gensim2.core.foreign.tree import ForeignTree, NotRegularError, refuse_special
from gensim2.core.record_files import read_record

REMEDY = "give the same settings; to start anew, delete the folder or choose another --out"


def command_line() -> list[str]:
    """Return the arguments after ``gensim2``, or an empty list if another program uses the Python package."""
    program = Path(sys.argv[0])
    name = program.parent.name if program.name == "__main__.py" else program.stem
    return sys.argv[1:] if name == "gensim2" else []


class FolderLock:
    """Lock of a folder. The lock is released at the end of the ``with`` block, or when the process ends.

    Symbolic links must not lead out of the folder, because writes would follow them. The lock file with the process id
    is never removed. Otherwise two processes could each lock a file of this name.

    Args:
        folder: the folder; it is created if missing.
        name: name of the lock file; nested runs on the same folder use different names.

    Raises:
        InputError: another process holds the lock, a link leads out of the folder, or the folder cannot be written to.
    """

    NAME = ".lock"

    def __init__(self, folder: Path, name: str = NAME) -> None:
        path = folder / name
        self._lock = FileLock(path, blocking=False, thread_local=False, fallback_to_soft=False)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            ForeignTree(folder).refuse_links_out()
            # If the lock file is a named pipe, reading the process id from it below would block forever.
            if path.exists():
                refuse_special(path.stat())
            self._lock.acquire()
        except Timeout as error:
            with path.open(encoding="ascii", errors="replace") as stream:
                owner = stream.read(32).strip()
            by = f" (process {owner})" if owner else ""
            wrong = f"another run is using this folder{by}"
            raise InputError(wrong, file=folder, remedy="wait for it, or choose another folder") from error
        except NotRegularError as error:
            raise InputError(str(error), file=path, remedy="remove it") from error
        except OSError as error:
            self._lock.release()
            remedy = "choose another folder with --out, on a local disk"
            raise InputError(f"cannot write: {error.strerror}", file=folder, remedy=remedy) from error
        self._path = path
        try:
            path.write_text(f"{os.getpid()}\n", encoding="ascii")
            self._status = path.stat()
        except OSError as error:
            self._lock.release()
            remedy = "free disk space, or choose another folder"
            raise WriteError(f"cannot write: {error.strerror}", file=path, remedy=remedy) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._require_kept()
        finally:
            self.release()

    def release(self) -> None:
        self._lock.release()

    def _require_kept(self) -> None:
        """Raise WriteError if the folder was removed or replaced during the run, which would lose written files."""
        try:
            is_kept = os.path.samestat(self._path.stat(), self._status)
        except OSError:
            is_kept = False
        if not is_kept:
            message = "was removed or replaced during the run"
            raise WriteError(message, file=self._path.parent, remedy="run it again")


class RunSettings(BaseModel):
    """Base class for the record of a resumable folder. The record has the settings that determine the results of a run.

    Attributes:
        FREE: settings that may change when a run is resumed. Nested settings are named ``group.setting``.
    """

    model_config = ConfigDict(extra="forbid")

    FREE: ClassVar[frozenset[str]] = frozenset()

    def differences(self, now: Self) -> Iterator[tuple[str, str]]:
        """Yield the field's name and a message for every setting that differs between this record and ``now``."""
        for name in type(self).model_fields:
            yield from differing(name, getattr(self, name), getattr(now, name), self.FREE)

    def resumed_by(self, now: Self) -> Self:
        """Return the record to store when a run with the settings ``now`` resumes the run of this record."""
        del now
        return self

    def require_same(self, now: Self, file: Path | None, remedy: str = REMEDY) -> None:
        """Check that a resuming run has the settings of this record.

        Args:
            now: settings of the resuming run.
            file: path of this record, for the error message.
            remedy: remedy for the error message.

        Raises:
            InputError: a setting differs; the message names the first one.
        """
        for field, message in self.differences(now):
            raise InputError(message, file=file, field=field, remedy=remedy)


def differing(field: str, was: Any, now: Any, free: frozenset[str] = frozenset()) -> Iterator[tuple[str, str]]:
    """Yield field and message for every difference between ``was`` and ``now``, except for the keys in ``free``."""
    if field in free:
        return
    was, now = (each.model_dump(mode="json") if isinstance(each, BaseModel) else each for each in (was, now))
    if isinstance(was, Mapping) and isinstance(now, Mapping):
        for key in sorted(was.keys() | now.keys()):
            yield from differing(f"{field}.{key}", was.get(key), now.get(key), free)
    elif was != now:
        yield field, f"was begun with {_short(was)}, not {_short(now)}"


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 100 else f"{text[:97]}..."


def held_already(
    folder: Path,
    holds: str,
    remedy: str = "add --resume to continue; to start anew, delete the folder or choose another --out",
) -> InputError:
    """Return the error for starting a new run in a folder that already contains a run."""
    return InputError(f"holds {holds} already", file=folder, remedy=remedy)


Settings = TypeVar("Settings", bound=RunSettings)


class ResumableFolder(Generic[Settings]):
    """Folder with the results of a run.

    The folder is locked while it is open. A file in it records the settings, so that the run can be resumed.

    The class is a context manager; the end of the ``with`` block releases the lock.

    Args:
        path: the folder; it is created if missing.
        marker: name of the file with the settings. A folder that has this file contains a run.
        settings: settings of this run.
        holds: description of the folder's content for error messages, for example ``"a run"``.
        resume: whether to continue the run that the folder contains.
        lock: name of the lock file; None if the caller has already locked an outer folder.
        alone: whether to refuse a folder that has other files but no run.

    Attributes:
        path: the folder.
        record: settings of the run; in a resumed folder, the settings of the first run.

    Raises:
        InputError: the folder is in use or not writable, or it has other settings or files, or it has a run and
            ``resume`` is false.
    """

    def __init__(
        self,
        path: Path,
        marker: str,
        settings: Settings,
        *,
        holds: str,
        resume: bool,
        lock: str | None = FolderLock.NAME,
        alone: bool = True,
    ) -> None:
        self.path, self._marker, self._alone = path, marker, alone
        self._check(holds, resume)
        self._lock = None if lock is None else FolderLock(path, lock)
        try:
            # Check again with the lock, because another process may have written the record after the first check.
            self._check(holds, resume)
            self._remove_temporaries()
            self.record = self._opened(settings)
        except BaseException:
            self.release()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: Any) -> None:
        try:
            # Remove files of killed workers. After an error of the block, such as a read-only disk, this may fail as
            # well. The caller then gets the error of the block, and the next run removes the files.
            with contextlib.nullcontext() if kind is None else contextlib.suppress(WriteError):
                self._remove_temporaries()
        finally:
            if self._lock is not None:
                self._lock.__exit__(kind, *error)

    def release(self) -> None:
        if self._lock is not None:
            self._lock.release()

    def save(self) -> None:
        """Write the record atomically.

        Raises:
            WriteError: the folder cannot be written to.
        """
        write_json(self.path / self._marker, self.record.model_dump(mode="json"))

    def _opened(self, settings: Settings) -> Settings:
        file = self.path / self._marker
        there = None
        if file.exists():
            there = read_record(file, type(settings), "restore the file, or choose another --out")
            there.require_same(settings, file)
            settings = there.resumed_by(settings)
        if settings != there:
            self.record = settings
            self.save()
        return settings

    def _remove_temporaries(self) -> None:
        remove_temporaries(self.path, subfolders=self._alone)  # other runs may own subfolders of a shared folder

    def _check(self, holds: str, resume: bool) -> None:
        path = self.path
        if not path.exists():
            return
        if not path.is_dir():
            raise InputError("is not a folder", file=path, remedy="choose another --out")
        if (path / self._marker).exists():
            if not resume:
                raise held_already(path, holds)
        # The file ``marker`` does not count as other content, because another run may create it after the check above.
        elif self._alone and any(
            entry.name not in (FolderLock.NAME, self._marker) and not entry.name.startswith(f".{self._marker}.")
            for entry in path.iterdir()
        ):
            held = holds.removeprefix("a ")
            wrong = f"the folder is not empty, but contains no {held}"
            raise InputError(wrong, file=path, remedy="choose another --out")

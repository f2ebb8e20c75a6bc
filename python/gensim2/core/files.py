"""Write files atomically: a file is either complete or absent, even after a power cut."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import json
import os
import re
import secrets
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from platformdirs import user_cache_dir

from gensim2.core.errors import InputError, WriteError
from gensim2.core.special_files import is_special, write_through

_TEMPORARY = re.compile(r"^\..+\.[0-9a-f]{16}\.tmp(\.\w+)?$")


def cache_dir() -> Path:
    """Return the cache folder: ``$GENSIM2_CACHE``, or else the user's cache folder.

    Raises:
        InputError: the variable is not set, and the account has no home folder.
    """
    return user_folder("GENSIM2_CACHE", lambda: user_cache_dir("gensim2"))


def user_folder(variable: str, default: Callable[[], Path | str]) -> Path:
    """Return the folder in an environment variable, or else a default folder below the user's home folder.

    Args:
        variable: name of the environment variable.
        default: function that returns the folder if the variable is not set, or raises RuntimeError if there is no home
            folder.

    Raises:
        InputError: the variable is not set, and the account has no home folder.
    """
    try:
        return Path(os.environ.get(variable) or default())
    except RuntimeError as error:
        remedy = f"set {variable} to a folder, or HOME"
        wrong = "this account has no home folder, and the variable is not set"
        raise InputError(wrong, field=variable, remedy=remedy) from error


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path in the folder of ``path``; the file written there replaces ``path`` when the block ends.

    ``path`` is always either the complete old file or the complete new file, even after a power cut, because data and
    renaming are written to disk before the block ends. If the block fails, ``path`` is not changed.

    The temporary path has the suffix of ``path``, because some libraries choose the file format by the suffix.

    If ``path`` is a symbolic link, the link itself is replaced, because it could lead out of an untrusted folder.

    Raises:
        WriteError: the folder cannot be written to, or the disk is full.
    """
    temporary = path.with_name(f".{path.name[:50]}.{secrets.token_hex(8)}.tmp{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield temporary
            with temporary.open("rb") as stream:
                os.fsync(stream.fileno())
            temporary.chmod(0o644)
            temporary.replace(path)
            sync_folder(path.parent)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise not_written(error, path) from error


def not_written(error: OSError, path: Path) -> WriteError:
    """Return the error for a file that cannot be written, with a remedy that fits the cause."""
    full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
    remedy = "free disk space, and resume with --resume" if full else "choose another folder with --out"
    return WriteError(f"cannot write: {error.strerror or error}", file=path, remedy=remedy)


@contextlib.contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """Yield a temporary folder next to ``path``. When the block ends, the temporary folder is renamed to ``path``.

    ``path`` must not exist, or it must be an empty folder. If the block fails, its temporary folder is removed. The
    next call removes the temporary folder of a killed process. A power cut may lose files, so use this only for data
    that can be created again.

    Raises:
        InputError: ``path`` is not empty.
        WriteError: the folder cannot be written to, or the disk is full.
    """
    path = Path(os.path.realpath(path))
    taken = InputError("is not an empty folder", file=path, remedy="choose another folder with --out")
    if path.is_file() or (path.exists() and any(path.iterdir())):
        raise taken
    filled = path.with_name(f".{path.name[:50]}.{secrets.token_hex(8)}.tmp")
    handle = -1
    try:
        try:
            # If the parent path is a file, ``_locked`` below raises a better message.
            with contextlib.suppress(FileExistsError):
                path.parent.mkdir(parents=True, exist_ok=True)
            # Temporary folders without a lock may be removed. Therefore lock the parent until the new folder is locked.
            with _locked(path.parent) as alone:
                if alone:
                    _remove_left(path)
                filled.mkdir()
                handle = _folder_handle(filled)
                _lock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            yield filled
            # A replacement folder would be unlocked, and other processes could remove it.
            assert os.path.samestat(os.fstat(handle), filled.stat()), f"{filled} was replaced"
            try:
                filled.replace(path)
            except OSError as error:
                # another process has created a file or a non-empty folder at ``path``
                if error.errno in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR):
                    raise taken from error
                raise
        finally:
            shutil.rmtree(filled, ignore_errors=True)
            if handle >= 0:
                os.close(handle)
    except (OSError, WriteError) as error:
        remedy = "free disk space, or choose another folder with --out"
        raise WriteError(f"cannot write: {_reason(error)}", file=path, remedy=remedy) from error


@contextlib.contextmanager
def _locked(folder: Path, how: int = fcntl.LOCK_EX) -> Iterator[bool]:
    """Try to lock a folder itself during a block, with the flags ``how`` of ``fcntl.flock``.

    Yield whether it was locked.
    """
    handle = _folder_handle(folder)
    try:
        yield _lock(handle, how)
    finally:
        os.close(handle)


def _folder_handle(folder: Path) -> int:
    return os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)


def _lock(handle: int, how: int) -> bool:
    """Try to lock; return False if another process holds the lock or the file system supports no locks."""
    try:
        fcntl.flock(handle, how)
    except OSError:
        return False
    return True


def _remove_left(path: Path) -> None:
    """Remove temporary folders of ``path`` that killed processes left.

    Folders of running processes are locked and stay.
    """
    pattern = re.compile(rf"^\.{re.escape(path.name[:50])}\.[0-9a-f]{{16}}\.tmp$")
    for left in path.parent.iterdir():
        if not pattern.match(left.name) or left.is_symlink() or not left.is_dir():
            continue
        with _locked(left, fcntl.LOCK_EX | fcntl.LOCK_NB) as free:
            if free:
                shutil.rmtree(left, ignore_errors=True)


def _reason(error: OSError | WriteError) -> str:
    """Return the message of a system error without the name of the temporary file."""
    said = error.message if isinstance(error, WriteError) else error.strerror or str(error)
    text = said.removeprefix("cannot write: ")
    # Libraries format error numbers differently: "[Errno 28] ...", "[errno 28] ...", "errno = 28, error message = ...".
    number = re.search(r"errno (?:= )?(\d+)", text, re.IGNORECASE)
    return os.strerror(int(number[1])) if number else text


def check_writable(path: Path) -> None:
    """Check that the output file ``path`` can be written. Nothing is written.

    Raises:
        InputError: the file cannot be written; the message gives the reason.
    """
    try:
        if is_special(path):
            return  # Pipes and devices are not opened, because this can have side effects.
        target = Path(os.path.realpath(path))
        with tempfile.TemporaryFile(dir=next(folder for folder in target.parents if folder.exists())):
            pass
    except OSError as error:
        raise InputError(f"cannot write: {error.strerror}", file=path, remedy="choose another file") from error


def write_atomic(path: Path, data: str | bytes) -> None:
    """Write ``data`` to ``path`` atomically (see :func:`replacing`).

    Raises:
        WriteError: the folder cannot be written to, or the disk is full.
    """
    with replacing(path) as temporary:
        temporary.write_bytes(_encoded(data))


def write_changed(path: Path, text: str) -> None:
    """Write ``text`` to ``path`` atomically. If the file already has this content, do not touch it."""
    content = text.encode()
    # Compare sizes first, because the file may be untrusted and too large to be read.
    if not path.is_file() or path.stat().st_size != len(content) or path.read_bytes() != content:
        write_atomic(path, content)


def write_output(path: Path, data: str | bytes) -> None:
    """Write data to a path that the user chose.

    A file is replaced atomically, also if ``path`` is a link to it. A pipe or device is written directly.

    Raises:
        InputError: the path cannot be written to, or the disk is full.
    """
    try:
        if is_special(path):
            write_through(path, _encoded(data))
            return
    except OSError as error:
        raise InputError(f"cannot write: {error.strerror}", file=path, remedy="choose another") from error
    write_atomic(Path(os.path.realpath(path)), data)


def _encoded(data: str | bytes) -> bytes:
    """Encode text as UTF-8. Invalid bytes of file names become escape sequences."""
    return data.encode(errors="backslashreplace") if isinstance(data, str) else data


def append(path: Path, data: str | bytes) -> None:
    """Append data to a log file. The folder must exist, so that a removed folder is noticed.

    Raises:
        WriteError: the file cannot be written to, or the disk is full.
    """
    try:
        with path.open("ab") as stream:
            stream.write(_encoded(data))
    except OSError as error:
        raise not_written(error, path) from error


def write_json(path: Path, value: Any) -> None:
    """Write ``value`` as indented JSON, atomically; NaN is refused."""
    write_atomic(path, json.dumps(value, indent=2, allow_nan=False) + "\n")


def remove_temporaries(folder: Path, *, subfolders: bool = True) -> None:
    """Remove the temporary files of killed processes from a folder. No process may be writing there.

    Args:
        folder: the folder; it may be missing.
        subfolders: whether to remove files in all subfolders, too.

    Raises:
        WriteError: a file cannot be removed.
    """
    pattern = ".*.tmp*"
    for path in sorted(folder.rglob(pattern) if subfolders else folder.glob(pattern)):
        if _TEMPORARY.match(path.name) and path.is_file():
            remove(path)


def remove(path: Path) -> None:
    """Remove a file, which may be missing.

    Raises:
        WriteError: the file cannot be removed, for example because the disk is read-only.
    """
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise not_written(error, path) from error


def sync_folder(folder: Path) -> None:
    """Wait until the directory entries of a folder are on disk."""
    handle = _folder_handle(folder)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)

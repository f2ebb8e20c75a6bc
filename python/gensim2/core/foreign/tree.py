"""Read an untrusted folder: only regular files inside it, of limited size, are opened."""

from __future__ import annotations

import os
import shutil
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, ClassVar, NamedTuple

from gensim2.core.errors import InputError
from gensim2.core.foreign.limits import MAX_COPIED, MAX_FILE_BYTES, MAX_FILES, MAX_FOLDER_DEPTH, MAX_RECORD

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFLNK: "a link",
}
_BLOCK = 2**20
_PUT_A_FILE = "put a regular file in its place"


class NotRegularError(OSError):
    """A path leads to a folder, pipe, socket or device; the first argument names the type."""


class TooLargeError(OSError):
    """A file is larger than allowed; the first argument states the limit."""


def open_regular(path: Path) -> BinaryIO:
    """Open a regular file for reading. Raise an error at once for a pipe, which would wait for a writer.

    Raises:
        NotRegularError: the path is not a regular file.
        OSError: the file cannot be opened.
    """
    refuse_special(path.stat())  # check before opening, because opening a device can have side effects
    stream = os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb")
    try:
        refuse_special(os.fstat(stream.fileno()))  # check again: the file may have been replaced meanwhile
    except BaseException:
        stream.close()
        raise
    return stream


def read_regular(path: Path, max_bytes: int) -> bytes:
    """Read a regular file no larger than ``max_bytes``.

    Raises:
        NotRegularError, TooLargeError: the path is not a regular file, or the file is larger.
        OSError: the file cannot be read.
    """
    with open_regular(path) as stream:
        size = os.fstat(stream.fileno()).st_size
        # Python allocates the requested number of bytes, so request the size of the file and not max_bytes.
        content = b"" if size > max_bytes else stream.read(size + 1)
        # Some files, for example in /proc, report the size 0, so reading continues until the end.
        while size < len(content) <= max_bytes and (block := stream.read(_BLOCK)):
            content += block
    if max(size, len(content)) > max_bytes:
        raise TooLargeError(f"is larger than {megabytes(max_bytes)}")
    return content


def read_input(path: Path, max_bytes: int, remedy: str | None = None, missing: bytes | None = None) -> bytes:
    """Read a regular file no larger than ``max_bytes``.

    Raises:
        InputError: the file cannot be read; the message includes the ``remedy``.
    """
    try:
        return read_regular(path, max_bytes)
    except OSError as error:
        if missing is not None and isinstance(error, FileNotFoundError):
            return missing
        raise InputError(why(error), file=path, remedy=remedy) from error


def why(error: OSError) -> str:
    """Return the reason why :func:`read_regular` failed, as text that follows the file name in an error message."""
    if isinstance(error, NotRegularError | TooLargeError):
        return str(error)
    return f"cannot be read: {error.strerror or error}"


def refuse_special(found: os.stat_result) -> None:
    """Refuse anything but a regular file.

    Raises:
        NotRegularError: the path is a folder, pipe, socket or device; the message says which.
    """
    if not stat.S_ISREG(found.st_mode):
        kind = _KINDS.get(stat.S_IFMT(found.st_mode), "something else")
        raise NotRegularError(f"is {kind}, not a file")


class Reference(NamedTuple):
    """The place where a file name occurs, for error messages.

    Attributes:
        file: file that mentions the file name, relative to the folder.
        field: field of this file that contains the file name.
    """

    file: str
    field: str


@dataclass(frozen=True)
class ForeignTree:
    """An untrusted folder, which may itself be a link; links in the folder must not lead out of the folder."""

    path: Path

    ERROR: ClassVar[type[InputError]] = InputError
    MISSING: ClassVar[type[InputError]] = InputError
    MAX_FILES: ClassVar[int] = MAX_FILES

    def read(self, name: str, max_bytes: int = MAX_RECORD, named_by: Reference | None = None) -> bytes:
        """Return the content of the file ``name``, relative to the folder.

        Args:
            max_bytes: largest size of the file.
            named_by: file and field that contain the name, for error messages.

        Raises:
            InputError: the file is missing, outside the folder, not a regular file, too large, or cannot be read.
        """
        try:
            return read_regular(self.inside(name, named_by), max_bytes)
        except (FileNotFoundError, NotADirectoryError) as error:
            missing = self._error(why(error), name, named_by)
            raise self.MISSING(missing.message, file=missing.file, field=missing.field) from error
        except OSError as error:
            remedy = {NotRegularError: _PUT_A_FILE, TooLargeError: "make it smaller"}.get(type(error))
            raise self._error(why(error), name, named_by, remedy) from error
        except ValueError as error:
            raise self._error("is not a file name", repr(name), named_by) from error

    def inside(self, name: str, named_by: Reference | None = None) -> Path:
        """Check that ``name``, a path relative to the folder, lies inside the folder, and return its full path.

        Raises:
            InputError: a symbolic link or ``..`` leads out of the folder.
            OSError: symbolic links form a loop.
        """
        path = self.path / name
        if not _inside(path, self.path):
            raise self._error("lies outside the folder", name, named_by, "copy it into the folder")
        return path

    def has(self, name: str) -> bool:
        path = self.path / name
        try:
            return _inside(path, self.path) and path.is_file()
        except (OSError, ValueError):
            return False

    def copy(self, name: str, to: Path, max_bytes: int) -> None:
        """Copy the file ``name`` to the file ``to`` in an existing folder."""
        content = self.read(name, max_bytes)
        to.write_bytes(content)

    def copy_all(self, to: Path, leave_out: str | None = None) -> None:
        """Copy the folder, which may contain only folders and regular files.

        Args:
            to: an existing folder.
            leave_out: subfolders with this name are not copied.

        Raises:
            InputError: as for :meth:`sizes`, or a file is larger than ``MAX_COPIED``.
        """
        sizes = self.sizes()
        for name, size in sizes.items():
            if size > MAX_COPIED:
                raise self._error(f"is larger than {megabytes(MAX_COPIED)}", name, None, "remove it")
        for name in sizes:
            if leave_out not in Path(name).parts:
                (to / name).parent.mkdir(parents=True, exist_ok=True)
                with open_regular(self.inside(name)) as source, (to / name).open("wb") as target:
                    shutil.copyfileobj(source, target)

    def names(self, under: str = "") -> list[str]:
        """Return the relative paths of all entries except folders, sorted. Links are not followed.

        Raises:
            InputError: the folder has too many files, or a folder cannot be read.
        """
        found: list[tuple[str, ...]] = []
        for path in self._walk(self.path / under):
            found.append(path.relative_to(self.path).parts)
            if len(found) > self.MAX_FILES:
                wrong = f"holds over {self.MAX_FILES} files"
                raise self.ERROR(wrong, file=self.path, remedy="remove files that do not belong there")
        return [str(Path(*parts)) for parts in sorted(found)]

    def sizes(self) -> dict[str, int]:
        """Check that the folder has only folders and regular files. Return the size of each file by its relative path.

        After this check, the folder may be given to a library that opens the files itself.

        Raises:
            InputError: there is a link or a special file, files are too many or too large, or folders are nested too
                deeply.
        """
        found: dict[str, int] = {}
        waiting = [(self.path, "", 0)]
        while waiting:
            folder, prefix, depth = waiting.pop()
            try:
                with os.scandir(folder) as entries:
                    for entry in entries:
                        name = prefix + entry.name
                        status = entry.stat(follow_symlinks=False)
                        if stat.S_ISDIR(status.st_mode):
                            if depth >= MAX_FOLDER_DEPTH:
                                raise self._error(f"is nested more than {MAX_FOLDER_DEPTH} folders deep", name, None)
                            waiting.append((folder / entry.name, f"{name}/", depth + 1))
                            continue
                        if not stat.S_ISREG(status.st_mode):
                            kind = _KINDS.get(stat.S_IFMT(status.st_mode), "something else")
                            raise self._error(f"is {kind}, not a file", name, None, _PUT_A_FILE)
                        if status.st_size > MAX_FILE_BYTES:
                            raise self._error(f"is larger than {megabytes(MAX_FILE_BYTES)}", name, None)
                        found[name] = status.st_size
                        if len(found) > self.MAX_FILES:
                            remedy = "remove files that do not belong there"
                            raise self.ERROR(f"holds over {self.MAX_FILES} files", file=self.path, remedy=remedy)
            except OSError as error:
                raise self.ERROR(f"cannot be read: {error.strerror or error}", file=folder) from error
        return found

    def refuse_links_out(self) -> None:
        """Refuse symbolic links that lead out of the folder, because writing through them would change other files.

        Raises:
            InputError: a link leads out of the folder; the message names the first one.
        """
        for path in self._walk(self.path):
            if path.is_symlink() and not _inside(path, self.path):
                raise self.ERROR("is a link out of the folder", file=path, remedy="remove the link")

    def _walk(self, top: Path) -> Iterator[Path]:
        def refuse(error: OSError) -> None:
            if not isinstance(error, FileNotFoundError | NotADirectoryError):
                raise self.ERROR(f"cannot read: {error.strerror}", file=error.filename) from error

        for place, folders, files in os.walk(top, onerror=refuse):
            paths = [Path(place, name) for name in folders]
            yield from (Path(place, name) for name in files)
            yield from (path for path in paths if path.is_symlink())

    def _error(self, wrong: str, name: str, named_by: Reference | None, remedy: str | None = None) -> InputError:
        if named_by is None:
            return self.ERROR(wrong, file=self.path / shortened(name), remedy=remedy)
        file, field = self.path / named_by.file, named_by.field
        return self.ERROR(f"{shortened(name)} {wrong}", file=file, field=field, remedy=remedy)


def shortened(text: str) -> str:
    return text if len(text) <= 100 else f"{text[:97]}..."


def megabytes(size: int) -> str:
    return f"{size / 2**20:g} MiB"


def _inside(path: Path, folder: Path) -> bool:
    return Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder))

"""Files of one object: regular ones inside its folder, of bounded size; nothing else is ever opened."""

from __future__ import annotations

import hashlib
import json
import os
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from gensim2.objects.errors import AssetError, MissingFileError

MOST_FILES = 20_000
MOST_BYTES = 512 * 2**20  # of all files of an object
MOST_JSON = 2**20  # bytes of one file

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


class Reference(NamedTuple):
    """Where a file's name was found: a file of the object, and the field in it."""

    file: str
    field: str


@dataclass(frozen=True)
class ObjectFolder:
    """The folder of one object, which may itself be a link; what is in it may not lead out of it."""

    path: Path

    def read(self, name: str, most: int, named_by: Reference | None = None) -> bytes:
        """Content of the file ``name``, relative to the folder.

        Args:
            most: bytes that it may have.
            named_by: where the name was found, for errors.

        Raises:
            MissingFileError: there is none.
            AssetError: it lies outside the folder, is no regular file, is larger, or cannot be read.
        """
        path = self.path / name
        try:
            if not _inside(path, self.path):
                raise self._error("lies outside the folder", name, named_by, "copy it into the folder")
            self._refuse_special(path.stat(), name, named_by)
            with os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as stream:
                self._refuse_special(os.fstat(stream.fileno()), name, named_by)  # another one may lie there by now
                content = stream.read(most + 1)
        except (FileNotFoundError, NotADirectoryError) as error:
            missing = self._error(f"cannot be read: {error.strerror}", name, named_by)
            raise MissingFileError(missing.message, file=missing.file, field=missing.field) from error
        except OSError as error:
            raise self._error(f"cannot be read: {error.strerror or error}", name, named_by) from error
        except ValueError as error:
            raise self._error("is no file name", repr(name), named_by) from error
        if len(content) > most:
            raise self._error(f"is larger than {megabytes(most)}", name, named_by, "make it smaller")
        return content

    def _refuse_special(self, found: os.stat_result, name: str, named_by: Reference | None) -> None:
        if not stat.S_ISREG(found.st_mode):
            kind = _KINDS.get(stat.S_IFMT(found.st_mode), "something else")
            raise self._error(f"is {kind}, not a file", name, named_by, "put a regular file in its place")

    def _error(self, wrong: str, name: str, named_by: Reference | None, remedy: str | None = None) -> AssetError:
        if named_by is None:
            return AssetError(wrong, file=self.path / shortened(name), remedy=remedy)
        file, field = self.path / named_by.file, named_by.field
        return AssetError(f"{shortened(name)} {wrong}", file=file, field=field, remedy=remedy)

    def has(self, name: str) -> bool:
        """Whether a regular file ``name`` lies inside the folder."""
        path = self.path / name
        try:
            return _inside(path, self.path) and path.is_file()
        except (OSError, ValueError):
            return False

    def read_json(self, name: str) -> dict[str, Any]:
        """The object that a JSON file holds.

        Raises:
            MissingFileError: there is no such file.
            AssetError: it is not JSON, names a field twice, or holds something else than an object.
        """
        content, file = self.read(name, MOST_JSON), self.path / name
        try:
            value = json.loads(content.decode(), object_pairs_hook=_each_once)
        except RecursionError as error:
            raise AssetError("not JSON: nested too deeply", file=file) from error
        except ValueError as error:
            raise AssetError(f"not JSON: {error}", file=file) from error
        if not isinstance(value, dict):
            raise AssetError("holds no fields", file=file, remedy='write {"field": value, ...}')
        return value

    def names(self, under: str = "") -> list[str]:
        """Paths of everything but folders, relative to the folder, sorted by their parts; links are not followed.

        Raises:
            AssetError: there are too many, or a folder cannot be read.
        """
        found: list[tuple[str, ...]] = []
        for path in self._walk(self.path / under):
            found.append(path.relative_to(self.path).parts)
            if len(found) > MOST_FILES:
                raise AssetError(f"holds over {MOST_FILES} files", file=self.path, remedy="remove what is not its own")
        return [str(Path(*parts)) for parts in sorted(found)]

    def _walk(self, top: Path) -> Iterator[Path]:
        def refuse(error: OSError) -> None:
            if not isinstance(error, FileNotFoundError | NotADirectoryError):
                raise AssetError(f"cannot read: {error.strerror}", file=error.filename) from error

        for place, folders, files in os.walk(top, onerror=refuse):
            paths = [Path(place, name) for name in folders]
            yield from (Path(place, name) for name in files)
            yield from (path for path in paths if path.is_symlink())

    def fingerprint(self) -> str:
        """Hex digest of names and contents of all files; of what is no regular file inside the folder, the name.

        Raises:
            AssetError: there are too many files, they are too large, or one cannot be read.
        """
        digest, names = hashlib.sha256(), self.names()
        if sum((self.path / name).lstat().st_size for name in names) > MOST_BYTES:
            remedy = "remove what is not its own"
            raise AssetError(f"holds over {megabytes(MOST_BYTES)}", file=self.path, remedy=remedy)
        for name in names:
            digest.update(os.fsencode(name))
            if self.has(name):
                digest.update(self.read(name, MOST_BYTES))
        return digest.hexdigest()


def existing_folder(where: Path | str, field: str | None = None, remedy: str | None = None) -> Path:
    """The folder that a user named, ``~`` expanded.

    Raises:
        AssetError: there is none.
    """
    try:
        folder = Path(where).expanduser()
        if str(where) and folder.is_dir():
            return folder
    except (OSError, RuntimeError, ValueError):  # a name too long, no such user, a NUL: no folder is called so
        folder = Path(shortened(str(where)))
    raise AssetError("no such folder", file=folder if str(where) else '""', field=field, remedy=remedy)


def shortened(text: str) -> str:
    """The beginning of a text, of at most 100 characters."""
    return text if len(text) <= 100 else f"{text[:97]}..."


def megabytes(size: int) -> str:
    """Bytes for people."""
    return f"{size / 2**20:g} MiB"


def _inside(path: Path, folder: Path) -> bool:
    return Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder))


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    value = dict(pairs)
    if len(value) != len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"field {twice[:40]!r} stands twice")
    return value

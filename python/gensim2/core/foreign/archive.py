"""A zip archive of tasks that a stranger may have made."""

from __future__ import annotations

import lzma
import struct
import zipfile
import zlib
from collections.abc import Sequence
from importlib.resources.abc import Traversable
from pathlib import Path

from gensim2.core.errors import InputError
from gensim2.core.foreign.tree import NotRegularError, open_regular

MAX_ARCHIVE = 256 * 2**20  # bytes of the file
MAX_ENTRIES = 100_000

#: What ``zipfile`` raises of a damaged archive: an unknown method is not implemented, a password is a runtime error.
DAMAGED = (
    OSError,
    EOFError,
    NotImplementedError,
    RuntimeError,
    ValueError,
    struct.error,
    zipfile.BadZipFile,
    zipfile.LargeZipFile,
    zlib.error,
    lzma.LZMAError,
)


def open_archive(path: Path) -> zipfile.Path:
    """Return the folder at the top of an archive.

    Raises:
        InputError: it is none, is too large, or holds too many entries.
    """
    try:
        with open_regular(path) as stream:
            stream.seek(0, 2)
            if stream.tell() > MAX_ARCHIVE:
                raise NotRegularError(f"it is larger than {MAX_ARCHIVE // 2**20} MiB")
        archive = zipfile.Path(path)
        check_members(archive.root.infolist(), MAX_ENTRIES)
    except DAMAGED as error:
        raise InputError(f"cannot be read as an archive of tasks: {error}", file=path) from error
    return archive


def check_members(members: Sequence[zipfile.ZipInfo], max_members: int) -> None:
    """Refuse too many members, and compression whose readers may unpack more than a caller asks for.

    ``zipfile`` limits the output of deflate only: of bzip2 and LZMA it unpacks a whole block of input.

    Raises:
        BadZipFile: says which limit was passed.
    """
    if len(members) > max_members:
        raise zipfile.BadZipFile(f"it has over {max_members} members")
    for member in members:
        if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise zipfile.BadZipFile(f"compression {member.compress_type} of {member.filename} is not supported")


def read_member(file: Traversable, max_bytes: int) -> bytes:
    """The first ``max_bytes`` bytes of a file in an archive.

    Raises:
        InputError: it is damaged, encrypted, or compressed in an unknown way.
    """
    try:
        with file.open("rb") as stream:
            return stream.read(max_bytes)
    except DAMAGED as error:
        remedy = "write the archive anew with `gensim2 tasks export`"
        raise InputError(f"cannot be read: {error}", file=str(file), remedy=remedy) from error

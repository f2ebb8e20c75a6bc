"""Read untrusted zip archives of tasks."""

from __future__ import annotations

import lzma
import os
import struct
import zipfile
import zlib
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import BinaryIO

from gensim2.core.errors import InputError
from gensim2.core.foreign.limits import MAX_ARCHIVE, MAX_ENTRIES
from gensim2.core.foreign.tree import NotRegularError, open_regular

_ENTRY = b"PK\x01\x02"  # signature of a directory entry

#: Exceptions of ``zipfile`` for damaged archives. NotImplementedError is for unknown compression and RuntimeError for
#: passwords.
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
    """Return the top folder of an archive.

    Raises:
        InputError: the file is not a zip archive, is too large, or has too many entries.
    """
    try:
        stream = open_regular(path)
        if os.fstat(stream.fileno()).st_size > MAX_ARCHIVE:
            raise NotRegularError(f"the archive is larger than {MAX_ARCHIVE // 2**20} MiB")
        archive = open_zip(stream, MAX_ENTRIES)
        archive.filename = str(path)  # error messages show this name; the stream itself has no name
        return zipfile.Path(archive)
    except DAMAGED as error:
        raise InputError(f"cannot be read as an archive of tasks: {error}", file=path) from error


def open_zip(stream: BinaryIO, max_members: int) -> zipfile.ZipFile:
    """Open a zip file with at most ``max_members`` entries. Every entry must be uncompressed or compressed by deflate.

    The check keeps an archive from filling the memory. ``zipfile`` creates an object for every entry, and cannot limit
    the size that it unpacks from a block of bzip2 or LZMA.

    Raises:
        BadZipFile: the file has too many entries, or an entry uses another compression.
    """
    count, tail = 0, b""
    while block := stream.read(2**20):
        count += (tail + block).count(_ENTRY)
        tail = block[1 - len(_ENTRY) :]
    if count > max_members:
        raise zipfile.BadZipFile(f"it has over {max_members} members")
    archive = zipfile.ZipFile(stream)
    for member in archive.infolist():
        if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise zipfile.BadZipFile(f"compression {member.compress_type} of {member.filename} is not supported")
    return archive


def read_member(file: Traversable, max_bytes: int) -> bytes:
    """Return the first ``max_bytes`` bytes of a file in an archive.

    Raises:
        InputError: the file is damaged, encrypted, or compressed in an unknown way.
    """
    try:
        with file.open("rb") as stream:
            return stream.read(max_bytes)
    except DAMAGED as error:
        remedy = "write the archive again with `gensim2 tasks export`"
        raise InputError(f"cannot be read: {error}", file=str(file), remedy=remedy) from error

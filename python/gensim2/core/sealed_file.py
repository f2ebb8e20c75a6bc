"""Read and write files whose first line states their type, version and checksum.

    bytes 0..511    ``<magic> <version> <sha256>``, a line feed, then zeros
    from 512 on     the body

HDF5 skips the first 512 bytes as a user block, so the body can be an HDF5 file. The checksum covers ``<magic>
<version>``, a line feed and the body. Files that have changed are refused before a library reads them, because they
could crash the library.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from gensim2.core.errors import InputError
from gensim2.core.files import write_atomic
from gensim2.core.foreign.tree import read_input

HEADER_SIZE = 512

MAX_BYTES = 2**30
"""Maximum file size, bytes; an episode takes 20 kB, its point clouds and the images of three cameras about 20 MB."""


@dataclass(frozen=True)
class Seal:
    """Type of a checksummed file.

    Attributes:
        magic: first word of the file.
        version: format version that the installed version of gensim2 writes and reads.
        message: error message for a damaged file.
        remedy: remedy for a damaged file.
        damaged: exception class for a damaged file.
    """

    magic: str
    version: int
    message: str
    remedy: str
    damaged: type[InputError]

    def write(self, path: Path, body: bytes) -> str:
        """Write a file atomically and return its digest.

        Raises:
            WriteError: the folder cannot be written to.
        """
        digest = self._digest(self.version, body)
        write_atomic(path, self._header(self.version, digest) + body)
        return digest

    def read(self, path: Path) -> tuple[str, bytes]:
        """Check a file and return its SHA-256 digest and its content (header and body).

        Raises:
            InputError: the file is unreadable or of an incompatible version. The error is ``self.damaged`` if bytes
                have changed.
        """
        content = read_input(path, MAX_BYTES, self.remedy)
        words = content[:HEADER_SIZE].split(b"\n")[0].split(b" ")
        if len(words) != 3 or words[0] != self.magic.encode() or not words[1].isdigit() or len(words[1]) > 9:
            raise self.broken(path)
        version = int(words[1])
        digest = self._digest(version, memoryview(content)[HEADER_SIZE:])
        if content[:HEADER_SIZE] != self._header(version, digest):
            raise self.broken(path)
        if version != self.version:
            raise InputError(
                f"is {version}, but this version of gensim2 reads files with schema version {self.version}",
                file=path,
                field="schema_version",
                remedy="use the version of gensim2 that wrote the file",
            )
        return digest, content

    def broken(self, path: Path, field: str | None = None) -> InputError:
        """Return the error to raise for a damaged file."""
        return self.damaged(self.message, file=path, field=field, remedy=self.remedy)

    def _digest(self, version: int, body: bytes | memoryview) -> str:
        found = hashlib.sha256(f"{self.magic} {version}\n".encode())
        found.update(body)
        return found.hexdigest()

    def _header(self, version: int, digest: str) -> bytes:
        return f"{self.magic} {version} {digest}\n".encode().ljust(HEADER_SIZE, b"\0")

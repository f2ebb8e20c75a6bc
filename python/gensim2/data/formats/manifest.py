"""Read and write ``gensim2.json``, the manifest of an export. The manifest has the size and the digest of every file.

The manifest is checked first. The user may change only ``README.md``. Unlisted files are not read.

Exports of older versions have no manifest, so their clouds and images are not checked.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field

from gensim2.core.errors import InputError
from gensim2.core.files import write_json
from gensim2.core.foreign.tree import ForeignTree, open_regular, why
from gensim2.core.record_files import read_record
from gensim2.data.card import CARD

Format = Literal["maniskill", "lerobot", "zarr"]
FORMATS: tuple[Format, ...] = get_args(Format)

MANIFEST = "gensim2.json"
MANIFEST_SCHEMA: Literal[1] = 1

REMEDY = "export again"

_BLOCK = 2**20


class _Record(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class FileRecord(_Record):
    """One file of an export.

    Attributes:
        size: bytes.
        sha256: digest, 64 hexadecimal digits.
    """

    size: Annotated[int, Field(ge=0)]
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class Manifest(_Record):
    """Content of ``gensim2.json``.

    Attributes:
        format: format of the export.
        files: record of each file by path, with forward slashes.
    """

    schema_version: Literal[1] = MANIFEST_SCHEMA
    format: Format
    episodes: Annotated[int, Field(ge=1)]
    files: dict[str, FileRecord]


def write_manifest(out: Path, kind: Format, episodes: int) -> None:
    """Write the manifest of a finished export.

    Raises:
        WriteError: the manifest cannot be written.
    """
    files = {
        name: {"size": size, "sha256": _digest(out / name)} for name, size in sorted(ForeignTree(out).sizes().items())
    }
    files.pop(CARD, None)
    write_json(
        out / MANIFEST, {"schema_version": MANIFEST_SCHEMA, "format": kind, "episodes": episodes, "files": files}
    )


def check_format(path: Path, sizes: Mapping[str, int], kind: Format) -> None:
    """Check that the export's manifest, if it exists, states the format ``kind``.

    Args:
        sizes: size of each file in the export (:meth:`~gensim2.core.foreign.tree.ForeignTree.sizes`).

    Raises:
        InputError: the export has another format.
    """
    manifest = _read(path, sizes)
    if manifest is not None and manifest.format != kind:
        remedy = f"use --from {manifest.format}"
        wrong = f"the export has the format {manifest.format}, not {kind}"
        raise InputError(wrong, file=path, field="format", remedy=remedy)


def check_manifest(path: Path, sizes: Mapping[str, int]) -> Manifest | None:
    """Compare an export with its manifest and return the manifest; None if the export has no manifest.

    Args:
        sizes: as for :func:`check_format`.

    Raises:
        InputError: a file is missing or was changed.
    """
    manifest = _read(path, sizes)
    if manifest is None:
        return None
    for name, record in manifest.files.items():
        if name not in sizes:
            wrong = "this file does not exist, although the manifest lists it"
            raise InputError(wrong, file=path / MANIFEST, field=name, remedy=REMEDY)
        if sizes[name] != record.size or _digest(path / name) != record.sha256:
            raise InputError("was changed since it was exported", file=path / name, remedy=REMEDY)
    return manifest


def _read(path: Path, sizes: Mapping[str, int]) -> Manifest | None:
    return read_record(path / MANIFEST, Manifest, REMEDY) if MANIFEST in sizes else None


def _digest(file: Path) -> str:
    digest = hashlib.sha256()
    try:
        with open_regular(file) as stream:
            while block := stream.read(_BLOCK):
                digest.update(block)
    except OSError as error:
        raise InputError(why(error), file=file, remedy=REMEDY) from error
    return digest.hexdigest()

"""Cache prepared objects on disk for all processes of a user. No process sees an incomplete object."""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import shutil
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from filelock import FileLock
from pydantic import TypeAdapter

import gensim2
from gensim2.core.arrays import Array
from gensim2.core.errors import InputError, one_line
from gensim2.core.files import cache_dir, write_atomic
from gensim2.core.foreign.limits import MAX_OBJECT
from gensim2.objects.library.folder import ObjectFolder
from gensim2.objects.types import ArticulatedObject, AssetError, RigidObject

MANIFEST, INSTANCE, URDF = "files.json", "instance.json", "mobility.urdf"
#: Exceptions of NumPy's archive reader on corrupt or truncated files.
DAMAGE = (
    OSError,
    ValueError,
    KeyError,
    EOFError,
    MemoryError,
    NotImplementedError,
    RuntimeError,
    struct.error,
    zipfile.BadZipFile,
    zlib.error,
)


# Modules that affect every prepared object. Keys also contain digests of the reader of the object.
SHARED_MODULES = (
    "gensim2.objects.library.cache",
    "gensim2.core.foreign.tree",
    "gensim2.objects.library.folder",
    "gensim2.objects.library.prepare",
    "gensim2.objects.types",
    "gensim2.objects.model",
    "gensim2.objects.physics",
    "gensim2.objects.placement",
    "gensim2.objects.shapes",
)


_Model = TypeVar("_Model", ArticulatedObject, RigidObject)


def file_name(word: str) -> str:
    """Convert a word for file names.

    The result has 40 characters at most, and ``_`` for all characters except ``A-Za-z0-9_.-``.
    """
    return re.sub(r"[^A-Za-z0-9_.-]", "_", word)[:40]


@cache
def source_digest(*modules: str) -> str:
    """Return a digest of the modules' source code, so that objects prepared by other code are not reused."""
    digest = hashlib.sha256()
    top = Path(gensim2.__file__).parents[1]
    for module in modules:
        digest.update(module.encode())
        digest.update((top / f"{module.replace('.', '/')}.py").read_bytes())
    return digest.hexdigest()[:12]


def cached_hulls(
    key: str, make: Callable[[], tuple[list[Array], dict[str, int]]]
) -> tuple[list[Array], dict[str, int]]:
    """Return the hulls (N, 3) and statistics of a decomposition.

    If the cache has no undamaged hulls of this key, ``make`` creates them.

    Raises:
        InputError: the cache folder cannot be written to.
    """
    file = cache_dir() / "hulls" / f"{key}.npz"
    found = _whole_hulls(file)
    if found is not None:
        return found
    hulls, counts = make()
    stream = io.BytesIO()
    np.savez_compressed(
        stream, **join_hulls(hulls), names=np.array(list(counts), str), counts=np.array(list(counts.values()), np.int64)
    )
    try:
        write_atomic(file, stream.getvalue())
    except InputError as error:
        raise _unwritable(file.parent, error.message) from error
    return hulls, counts


def _whole_hulls(file: Path) -> tuple[list[Array], dict[str, int]] | None:
    """Return the hulls and statistics that ``cached_hulls`` stored, or None if the file is missing or damaged."""
    try:
        stream = io.BytesIO(ObjectFolder(file.parent).read(file.name, MAX_OBJECT))
        with zipfile.ZipFile(stream) as archive:
            if archive.testzip() is not None:
                return None
        with np.load(stream) as data:
            counts = dict(zip(data["names"].tolist(), data["counts"].tolist(), strict=True))
            return split_hulls(data["points"], data["sizes"]), counts
    except (AssetError, *DAMAGE):
        return None


def join_hulls(hulls: Sequence[Array]) -> dict[str, Any]:
    """Return hulls, each (N, 3), as two arrays for ``np.savez``: ``points`` and ``sizes``."""
    points = np.concatenate(hulls) if hulls else np.zeros((0, 3))
    return {"points": points, "sizes": np.array([len(p) for p in hulls], np.int64)}


def split_hulls(points: Array, sizes: npt.NDArray[np.int64]) -> list[Array]:
    """Return the list of hulls that ``join_hulls`` stored in two arrays."""
    return np.split(points, np.cumsum(sizes)[:-1]) if len(sizes) else []


def prepared(key: str, make: Callable[[Path], ArticulatedObject]) -> ArticulatedObject:
    """Return the cached object of ``key``. If it is missing or damaged, ``make(folder)`` creates it.

    Raises:
        InputError: the cache folder cannot be written to.
    """

    def write(folder: Path) -> None:
        # The path is relative, because ``folder`` will be renamed.
        write_model(folder / INSTANCE, replace(make(folder), urdf=Path(URDF)))

    folder = folder_once(key, write)
    return replace(read_model(folder / INSTANCE, ArticulatedObject), urdf=folder / URDF)


def folder_once(key: str, make: Callable[[Path], None]) -> Path:
    """Return the cache folder of an object. If it is missing or damaged, ``make(folder)`` fills it.

    ``make`` fills a temporary folder, which is renamed when it is complete. Therefore two processes can create the same
    object at the same time. ``MANIFEST`` has the digests of all files. A folder with a wrong digest is discarded.

    Raises:
        InputError: the cache folder cannot be written to.
    """
    folder = cache_dir() / "objects" / key
    if _is_whole(folder):
        return folder
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(dir=folder.parent, prefix=f".{folder.name}."))
        try:
            entry = scratch / "entry"
            entry.mkdir()
            make(entry)
            files = ObjectFolder(entry)
            digests = {name: _digest(files, name) for name in files.names()}
            (entry / MANIFEST).write_text(json.dumps(digests))
            _replace_damaged(entry, folder)
        finally:
            shutil.rmtree(scratch, ignore_errors=True)
    except OSError as error:
        raise _unwritable(folder.parent, f"cannot write: {error.strerror or error}") from error
    return folder


def _replace_damaged(entry: Path, folder: Path) -> None:
    """Rename ``entry`` to ``folder``, unless another process has created a complete folder there in the meantime."""
    with FileLock(cache_dir() / "objects.lock"):
        if _is_whole(folder):
            return
        if os.path.lexists(folder):
            folder.rename(entry.parent / "damaged")
        entry.rename(folder)


def _is_whole(folder: Path) -> bool:
    files = ObjectFolder(folder)
    try:
        return all(_digest(files, name) == digest for name, digest in files.read_json(MANIFEST).items())
    except AssetError:
        return False


def _digest(files: ObjectFolder, name: str) -> str:
    return hashlib.sha256(files.read(name, MAX_OBJECT)).hexdigest()


def _unwritable(folder: Path, reason: str) -> InputError:
    remedy = "set GENSIM2_CACHE to a folder that can be written to"
    return InputError(f"the cache: {reason}", file=folder, remedy=remedy)


def write_model(file: Path, model: ArticulatedObject | RigidObject) -> None:
    """Write the data of a prepared object as JSON."""
    file.write_bytes(TypeAdapter(type(model)).dump_json(model, indent=1) + b"\n")


def read_model(file: Path, kind: type[_Model]) -> _Model:
    """Read the data of an object that :func:`write_model` wrote.

    Raises:
        AssetError: the file is damaged.
    """
    try:
        return TypeAdapter(kind).validate_json(file.read_bytes())
    except (OSError, ValueError, TypeError) as error:
        remedy = "delete this folder; it will be made again"
        raise AssetError(f"is damaged: {one_line(str(error))}", file=file.parent, remedy=remedy) from error

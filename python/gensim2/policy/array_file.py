"""Read and write named arrays in a compressed ``.npz`` file; writing replaces the file atomically."""

from __future__ import annotations

import io
import math
import os
import sys
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.lib.format import read_array_header_1_0, read_magic

from gensim2.core.errors import InputError
from gensim2.core.files import write_atomic
from gensim2.core.foreign.archive import open_zip
from gensim2.core.foreign.hdf5 import fits, shown_shape
from gensim2.core.foreign.library import read_by_library
from gensim2.core.foreign.tree import TooLargeError, megabytes, open_regular, why

MAX_BYTES = 2**28
"""Maximum total size of a file's arrays in memory, bytes; 64 of the largest point clouds take 50 MB."""

MAX_MEMBERS = 100

_OVERHEAD = MAX_MEMBERS * 2**16
"""Maximum size of a file in addition to its array data, bytes; one numpy header has at most 64 KiB."""
_MAX_HEADER = 1000
"""Maximum length of an array header, characters. numpy writes 118; Python's parser fails on deeply nested text."""
_REMEDY = "remove it and make it again"

Arrays = dict[str, npt.NDArray[Any]]
Expected = tuple[type[np.generic], tuple[int | None, ...]]
"""Data type and shape of an array; None in the shape allows any length of that axis."""


def write_arrays(path: Path, arrays: Mapping[str, npt.ArrayLike]) -> None:
    """Write named arrays to a file, and create the file's folder if it is missing.

    Raises:
        WriteError: the folder cannot be written to, or the disk is full.
    """
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **{name: np.asarray(values) for name, values in arrays.items()})  # type: ignore[arg-type]
    write_atomic(path, buffer.getvalue())


def read_arrays(path: Path, max_bytes: int = MAX_BYTES) -> Arrays:
    """Read a file that :func:`write_arrays` wrote.

    Untrusted files are safe to read, because pickle is not used and all sizes are checked.

    Args:
        path: the ``.npz`` file.
        max_bytes: maximum total size of the arrays in memory, bytes.

    Raises:
        InputError: the file is missing, damaged, or too large.
    """
    try:
        with open_regular(path) as stream:
            if os.fstat(stream.fileno()).st_size > max_bytes + _OVERHEAD:
                raise TooLargeError(f"the file is larger than {megabytes(max_bytes)}")
            with read_by_library(path, _REMEDY, "is damaged"), open_zip(stream, MAX_MEMBERS) as archive:
                return _arrays_in(archive, max_bytes)
    except OSError as error:
        raise InputError(why(error), file=path, remedy=_REMEDY) from error


def _arrays_in(archive: zipfile.ZipFile, max_bytes: int) -> Arrays:
    arrays: Arrays = {}
    left, members = max_bytes, archive.infolist()
    if sum(member.file_size for member in members) > max_bytes + _OVERHEAD:
        raise ValueError(f"the arrays take more than {megabytes(max_bytes)} of memory")
    for member in members:
        with archive.open(member) as stream:
            version = read_magic(stream)
            if version != (1, 0):  # refuse later versions of the npy format, because they allow headers of up to 4 GiB
                wrong = f"{member.filename} has version {version} of the npy format, but must have version (1, 0)"
                raise ValueError(wrong)
            shape, in_columns, dtype = read_array_header_1_0(stream, max_header_size=_MAX_HEADER)
            size = math.prod(shape) * dtype.itemsize
            if dtype.kind not in "biufU" or not dtype.isnative or min(shape, default=0) < 0:
                raise ValueError(f"{member.filename} has an unsupported type or shape: {dtype} {shape}")
            left -= size
            if left < 0:
                raise ValueError(f"the arrays take more than {megabytes(max_bytes)}")
            content = stream.read(size)
        values = np.frombuffer(bytearray(content), dtype).reshape(shape, order="F" if in_columns else "C")
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            raise ValueError(f"{member.filename} contains NaN or infinity")
        if values.dtype.kind == "U":
            # Decode the text once, because NumPy does not check code points.
            content.decode(f"utf-32-{sys.byteorder[0]}e")
        arrays[member.filename.removesuffix(".npy")] = values
    if len(arrays) < len(members):
        raise ValueError("two arrays share a name")
    return arrays


def require_shapes(arrays: Arrays, expected: Mapping[str, Expected], path: Path) -> None:
    """Check that all expected arrays exist with the right data type and shape.

    Args:
        arrays: the arrays that were read.
        expected: type and shape by name. A length of None is any length; along the first axis it must be the same for
            all arrays.
        path: file name for the error message.

    Raises:
        InputError: an array is missing, or has another data type or shape. The message names the first wrong array.
    """
    rows = None
    for name, (kind, shape) in expected.items():
        wanted, found = (rows, *shape[1:]) if shape else (), arrays.get(name)
        if found is None:
            said = "is missing"
        elif not np.issubdtype(found.dtype, kind):
            said = f"has the type {found.dtype}, not {np.dtype(kind).name}"
        elif not fits(found.shape, wanted):
            said = f"has the shape {found.shape}, not {shown_shape(wanted)}"
        else:
            rows = found.shape[0] if shape else rows
            continue
        raise InputError(f"the file is damaged, because the array {name!r} {said}", file=path, remedy=_REMEDY)

"""Named arrays in one compressed file, whole or not there at all."""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.lib.format import read_array_header_1_0, read_array_header_2_0, read_magic

from gensim2.errors import InputError
from gensim2.files import write_atomic
from gensim2.foreign.library import read_by_library
from gensim2.foreign.tree import megabytes, read_regular, why

MAX_BYTES = 2**34
"""Bytes of the arrays of one file; those that may come from anyone are given less."""

Arrays = dict[str, npt.NDArray[Any]]


def write_arrays(path: Path, arrays: Mapping[str, npt.ArrayLike]) -> None:
    """Write arrays by name; the folder is made where it is not there.

    Raises:
        WriteError: the folder cannot be written to, or is full.
    """
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **{name: np.asarray(values) for name, values in arrays.items()})  # type: ignore[arg-type]
    write_atomic(path, buffer.getvalue())


def read_arrays(path: Path, max_bytes: int = MAX_BYTES) -> Arrays:
    """Read what :func:`write_arrays` wrote; nothing is unpickled.

    Args:
        max_bytes: of the file, and of the arrays in memory together.

    Raises:
        InputError: the file is not there, is no regular file, is too large, or is damaged.
    """
    try:
        content = read_regular(path, max_bytes)
    except OSError as error:
        raise InputError(why(error), file=path) from error
    with read_by_library(path, "remove it and make it again", "is damaged"):
        archive = zipfile.ZipFile(io.BytesIO(content))
        if sum(each.file_size for each in archive.infolist()) > max_bytes:
            raise InputError(f"its arrays have over {megabytes(max_bytes)}", file=path)
        return {each.filename.removesuffix(".npy"): _array(archive.read(each)) for each in archive.infolist()}


def _array(data: bytes) -> npt.NDArray[Any]:
    """An array of NumPy's format; its header is compared with the bytes that there are before memory is taken."""
    stream = io.BytesIO(data)
    headers = {(1, 0): read_array_header_1_0, (2, 0): read_array_header_2_0}
    shape, is_fortran, dtype = headers[read_magic(stream)](stream)
    if dtype.hasobject or math.prod(shape) * dtype.itemsize != len(data) - stream.tell():
        raise ValueError(f"an array of shape {shape} and {dtype} has {len(data) - stream.tell()} bytes")
    found = np.frombuffer(data, dtype, offset=stream.tell()) if math.prod(shape) else np.zeros(0, dtype)
    return found.reshape(shape, order="F" if is_fortran else "C").copy()

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
from gensim2.foreign.archive import DAMAGED
from gensim2.foreign.hdf5 import fits, shown_shape
from gensim2.foreign.tree import megabytes, open_regular, why

MAX_BYTES = 2**28
"""Of the arrays of one file in memory: 64 of the largest clouds have 50 MB."""

_HEADERS = {(1, 0): read_array_header_1_0, (2, 0): read_array_header_2_0}

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
    """Read what :func:`write_arrays` wrote; nothing is unpickled, and sizes are compared before memory is taken.

    Args:
        max_bytes: limit of all arrays in memory together.

    Raises:
        InputError: the file is not there, is damaged, or is too large.
    """
    try:
        with open_regular(path) as stream, zipfile.ZipFile(stream) as archive:
            return _arrays_in(archive, max_bytes)
    except OSError as error:
        raise InputError(why(error), file=path) from error
    except DAMAGED as error:
        raise InputError(f"is damaged: {error}", file=path, remedy="remove it and make it again") from error


def _arrays_in(archive: zipfile.ZipFile, max_bytes: int) -> Arrays:
    arrays: Arrays = {}
    left = max_bytes
    for member in archive.infolist():
        with archive.open(member) as stream:
            version = read_magic(stream)
            if (read := _HEADERS.get(version)) is None:
                raise ValueError(f"{member.filename} is of version {version}")
            shape, in_columns, dtype = read(stream)
            size = math.prod(shape) * dtype.itemsize
            if dtype.kind not in "biufU" or min(shape, default=0) < 0:
                raise ValueError(f"{member.filename} holds {dtype} {shape}")
            left -= size
            if left < 0:
                raise ValueError(f"holds over {megabytes(max_bytes)}")
            content = stream.read(size)
        values = np.frombuffer(bytearray(content), dtype).reshape(shape, order="F" if in_columns else "C")
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            raise ValueError(f"{member.filename} holds numbers that are not finite")
        arrays[member.filename.removesuffix(".npy")] = values
    if len(arrays) < len(archive.infolist()):
        raise ValueError("two arrays have one name")
    return arrays


def require_shapes(arrays: Arrays, shapes: Mapping[str, tuple[int | None, ...]], path: Path) -> None:
    """Refuse arrays that are missing or of another shape.

    Args:
        arrays: of a file.
        shapes: that they must have, None for any length of an axis; first axes are equally long.
        path: of the file.

    Raises:
        InputError: names the first.
    """
    rows = None
    for name, shape in shapes.items():
        wanted, found = (rows, *shape[1:]), arrays[name].shape if name in arrays else None
        if found is None or not fits(found, wanted):
            said = "is missing" if found is None else f"has the shape {found}, not {shown_shape(wanted)}"
            raise InputError(f"is damaged: {name} {said}", file=path, remedy="remove it and make it again")
        rows = found[0]

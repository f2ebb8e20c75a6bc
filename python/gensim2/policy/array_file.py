"""Named arrays in one compressed file, whole or not there at all."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.errors import InputError
from gensim2.files import write_atomic
from gensim2.foreign.archive import DAMAGED

Arrays = dict[str, npt.NDArray[Any]]


def write_arrays(path: Path, arrays: Mapping[str, npt.ArrayLike]) -> None:
    """Write arrays by name; the folder is made where it is not there.

    Raises:
        WriteError: the folder cannot be written to, or is full.
    """
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **{name: np.asarray(values) for name, values in arrays.items()})  # type: ignore[arg-type]
    write_atomic(path, buffer.getvalue())


def read_arrays(path: Path) -> Arrays:
    """Read what :func:`write_arrays` wrote; nothing is unpickled.

    Raises:
        InputError: the file is not there, or is damaged.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except FileNotFoundError as error:
        raise InputError("is not there", file=path) from error
    except DAMAGED as error:
        raise InputError(f"is damaged: {error}", file=path, remedy="remove it and make it again") from error

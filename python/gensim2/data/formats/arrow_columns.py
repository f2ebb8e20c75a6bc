"""Convert frame arrays to Arrow columns and back."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import MissingExtraError

Array = npt.NDArray[Any]


def arrow_modules() -> tuple[ModuleType, ModuleType]:
    """Return the modules ``pyarrow`` and ``pyarrow.parquet``.

    Raises:
        MissingExtraError: pyarrow is not installed.
    """
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise MissingExtraError("pyarrow", "data") from error
    return pyarrow, pyarrow.parquet


def column_type(arrow: ModuleType, dtype: np.dtype[Any], shape: tuple[int, ...]) -> Any:
    """Return the Arrow type of a column of arrays of ``shape``: a number type, or nested lists of numbers."""
    found = arrow.from_numpy_dtype(dtype)
    for _ in shape if shape != (1,) else ():
        found = arrow.list_(found)
    return found


def to_column(arrow: ModuleType, values: Array) -> Any:
    """Convert an array (T, *shape) to an Arrow array, without creating Python objects for the numbers."""
    shape = values.shape[1:]
    column = arrow.array(np.ascontiguousarray(values).reshape(-1))
    if shape == (1,):
        return column
    for size in reversed(shape):
        offsets = np.arange(0, len(column) + 1, size, dtype=np.int32)
        column = arrow.ListArray.from_arrays(offsets, column)
    return column


def to_array(column: Any, shape: tuple[int, ...]) -> Array:
    """Convert a column of nested lists to one array, without creating Python objects for the numbers.

    Raises:
        ValueError: a number is missing, or a list has a wrong length.
    """
    found = column.combine_chunks()
    for size in shape if shape != (1,) else ():
        lengths = found.value_lengths().to_numpy(zero_copy_only=False)
        if found.null_count or (lengths != size).any():
            raise ValueError(f"each list in the column must have {size} values")
        found = found.flatten()
    if found.null_count:
        raise ValueError("a number is missing in the column")
    numbers: Array = found.to_numpy(zero_copy_only=False)
    return numbers if shape == (1,) else numbers.reshape(-1, *shape)

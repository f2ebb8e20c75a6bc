"""Arrays of frames as columns of Arrow tables, and back."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import MissingExtraError

Array = npt.NDArray[Any]


def arrow_modules() -> tuple[ModuleType, ModuleType]:
    """``pyarrow`` and ``pyarrow.parquet``.

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
    """Numbers, or lists of lists of them."""
    found = arrow.from_numpy_dtype(dtype)
    for _ in shape if shape != (1,) else ():
        found = arrow.list_(found)
    return found


def to_column(arrow: ModuleType, values: Array) -> Any:
    """(T, *shape) as an Arrow array, without a Python object a number."""
    shape = values.shape[1:]
    column = arrow.array(np.ascontiguousarray(values).reshape(-1))
    if shape == (1,):
        return column
    for size in reversed(shape):
        offsets = np.arange(0, len(column) + 1, size, dtype=np.int32)
        column = arrow.ListArray.from_arrays(offsets, column)
    return column


def to_array(column: Any, shape: tuple[int, ...]) -> Array:
    """A column of lists of lists as one array, without a Python object a number.

    Raises:
        ValueError: a number is missing, or a list is not as long as the others.
    """
    found = column.combine_chunks()
    for size in shape if shape != (1,) else ():
        lengths = found.value_lengths().to_numpy(zero_copy_only=False)
        if found.null_count or (lengths != size).any():
            raise ValueError(f"a list is not of {size} values")
        found = found.flatten()
    if found.null_count:
        raise ValueError("a value is missing")
    numbers: Array = found.to_numpy(zero_copy_only=False)
    return numbers if shape == (1,) else numbers.reshape(-1, *shape)

"""Numbers and arrays as bytes: one header of JSON, then the arrays as they are; no code can hide in it."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.errors import InputError

_TYPES = ("uint8", "uint16", "int16", "int32", "int64", "float32", "float64", "bool")
_LARGEST = 1 << 28
"""Bytes of one message at most."""


def pack(plain: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]]) -> bytes:
    """Plain data and arrays, by name."""
    kept = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    told = {name: [array.dtype.name, list(array.shape)] for name, array in kept.items()}
    head = json.dumps({"plain": plain, "arrays": told}).encode()
    return b"".join([struct.pack("<I", len(head)), head, *(array.data for array in kept.values())])


def unpack(data: bytes) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
    """Undo the packing.

    Raises:
        InputError: it was not packed so, or is damaged.
    """
    try:
        (length,) = struct.unpack_from("<I", data)
        head = json.loads(data[4 : 4 + length])
        arrays, at = {}, 4 + length
        for name, (kind, shape) in head["arrays"].items():
            count = int(np.prod(shape, dtype=np.int64))
            if kind not in _TYPES or min(shape, default=0) < 0 or count > _LARGEST:
                raise ValueError(f"array {name!r} cannot be so")
            arrays[name] = np.frombuffer(data, dtype=kind, count=count, offset=at).reshape(shape)
            at += arrays[name].nbytes
        if at != len(data):
            raise ValueError(f"{len(data) - at} bytes are left over")
        return head["plain"], arrays
    except (struct.error, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"is damaged: {error}", field="message") from error

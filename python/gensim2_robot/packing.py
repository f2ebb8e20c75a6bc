"""Numbers and arrays as bytes: one header of JSON, then the arrays as they are; no code can hide in it."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, Field, ValidationError

from gensim2.core.errors import InputError
from gensim2.core.validation import input_error

MAX_MESSAGE = 1 << 26
"""Bytes of one message at most."""
MAX_HEAD = 1 << 20
"""Bytes of a message's header at most."""

_Type = Literal["uint8", "uint16", "int16", "int32", "int64", "float32", "float64", "bool"]
_Shape = Annotated[list[Annotated[int, Field(ge=0, le=MAX_MESSAGE, strict=True)]], Field(max_length=8)]


class _Head(BaseModel):
    plain: dict[str, Any]
    arrays: dict[str, tuple[_Type, _Shape]]


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
        if length > MAX_HEAD:
            raise ValueError(f"its head has {length} bytes, {MAX_HEAD} at most")
        head = _Head.model_validate(json.loads(data[4 : 4 + length], parse_int=_whole))
        arrays, at = {}, 4 + length
        for name, (kind, shape) in head.arrays.items():
            count = 1
            for size in shape:
                count = min(count * size, len(data) + 1)  # no more than there can be: zeros may follow
            found = np.frombuffer(data, dtype=kind, count=count, offset=at)
            arrays[name] = found.reshape(shape).copy()  # a view would keep the whole message
            at += arrays[name].nbytes
        if at != len(data):
            raise ValueError(f"{len(data) - at} bytes are left over")
        return head.plain, arrays
    except ValidationError as error:
        raise input_error(error, within="message") from error
    except (struct.error, ValueError, RecursionError) as error:
        raise InputError(f"is damaged: {error}", field="message") from error


def _whole(digits: str) -> int:
    """Refuse whole numbers of over 64 bits, which floats and arrays cannot hold."""
    if len(digits) > 20 or not -(2**63) <= (value := int(digits)) < 2**64:
        raise ValueError("a whole number of over 64 bits")
    return value

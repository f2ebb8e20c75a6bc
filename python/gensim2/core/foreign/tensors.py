"""Read untrusted safetensors files; sizes are checked before memory is allocated."""

from __future__ import annotations

import contextlib
import hashlib
import os
import threading
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from gensim2.core.errors import InputError
from gensim2.core.foreign.library import read_by_library
from gensim2.core.foreign.limits import MAX_TENSOR_HEADER
from gensim2.core.foreign.tree import TooLargeError, megabytes, open_regular, read_input, why

if TYPE_CHECKING:
    import torch

MISMATCH = "the weights do not fit the configuration"


class Shape(NamedTuple):
    """Data type and shape of a tensor. The data type has the name that safetensors uses, for example ``F32``."""

    dtype: str
    shape: tuple[int, ...]

    @staticmethod
    def of(tensor: torch.Tensor) -> Shape:
        """Return data type and shape of a tensor, which may be on PyTorch's meta device."""
        import torch

        names = {
            torch.float16: "F16",
            torch.float32: "F32",
            torch.float64: "F64",
            torch.int64: "I64",
            torch.bool: "BOOL",
        }
        return Shape(names[tensor.dtype], tuple(tensor.shape))

    def __str__(self) -> str:
        return f"{self.dtype} {list(self.shape)}"


def read_shapes(path: Path, max_bytes: int, remedy: str) -> dict[str, Shape]:
    """Return data type and shape of each tensor in a file, by name, without reading the tensors.

    Args:
        max_bytes: largest size of the file.
        remedy: remedy for the error message.

    Raises:
        InputError: the file is not a regular file, is too large, or is damaged.
    """
    from safetensors import safe_open

    try:
        with open_regular(path) as stream:
            if os.fstat(stream.fileno()).st_size > max_bytes:
                raise TooLargeError(f"the file is larger than {megabytes(max_bytes)}")
            header = int.from_bytes(stream.read(8), "little")
    except OSError as error:
        raise InputError(why(error), file=path, remedy=remedy) from error
    if header > MAX_TENSOR_HEADER:
        raise InputError(f"has a header of {header} bytes, more than {MAX_TENSOR_HEADER}", file=path, remedy=remedy)
    found = {}
    with read_by_library(path, remedy, "is damaged"), safe_open(path, "pt") as file:
        for name in file.keys():  # noqa: SIM118 - not a mapping
            tensor = file.get_slice(name)
            found[name] = Shape(tensor.get_dtype(), tuple(tensor.get_shape()))
    return found


@contextlib.contextmanager
def only_shapes(shapes: Iterable[Shape], path: Path, remedy: str) -> Iterator[None]:
    """Restrict the PyTorch weights that this thread can create in the block.

    The weights must have the types and shapes in ``shapes``, and each shape is used only once.

    A configuration of a larger model than its weights file is thus refused before the model fills the memory.

    Raises:
        InputError: the module creates a weight that ``shapes`` does not list.
    """
    from torch.nn.modules import module

    left, thread = Counter(shapes), threading.get_ident()

    def take(_: object, name: str, tensor: torch.Tensor | None) -> None:
        if tensor is not None and threading.get_ident() == thread:
            shape = Shape.of(tensor)
            left[shape] -= 1
            if left[shape] < 0:
                wrong = f"{MISMATCH}: the file has no tensor of type and shape {shape} for {name}"
                raise InputError(wrong, file=path, remedy=remedy)

    with contextlib.ExitStack() as hooks:
        hooks.callback(module.register_module_parameter_registration_hook(take).remove)
        hooks.callback(module.register_module_buffer_registration_hook(take).remove)
        yield


def require_shapes(path: Path, found: Mapping[str, Shape], expected: Mapping[str, Shape], remedy: str) -> None:
    """Check that a file has exactly the expected tensors.

    Raises:
        InputError: a tensor is missing, unknown, or of a wrong type or shape; the message names the first one.
    """
    for name, shape in expected.items():
        if found.get(name) != shape:
            there = f"has the type and shape {found[name]}" if name in found else "is missing"
            wrong = f"{MISMATCH}: the tensor {name} {there}; the expected type and shape are {shape}"
            raise InputError(wrong, file=path, remedy=remedy)
    for name in found:
        if name not in expected:
            raise InputError(f"{MISMATCH}: the tensor {name} is unknown", file=path, remedy=remedy)


def read_tensors(path: Path, max_bytes: int, sha256: str, remedy: str) -> dict[str, torch.Tensor]:
    """Return the tensors of a file by name; call :func:`read_shapes` and check the shapes first.

    Args:
        max_bytes: largest size of the file.
        sha256: required digest of the file's content, in hexadecimal digits.
        remedy: remedy for the error message.

    Raises:
        InputError: the file cannot be read, has a wrong digest, or contains NaN or infinity.
    """
    from safetensors.torch import load

    content = read_input(path, max_bytes, remedy)
    if hashlib.sha256(content).hexdigest() != sha256:
        raise InputError("is damaged: its digest does not match", file=path, remedy=remedy)
    with read_by_library(path, remedy, "is damaged"):
        tensors: dict[str, torch.Tensor] = load(content)
    for name, tensor in tensors.items():
        if not tensor.isfinite().all():
            raise InputError("the tensor contains numbers that are not finite", file=path, field=name, remedy=remedy)
    return tensors

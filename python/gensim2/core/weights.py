"""Store network weights next to a JSON record.

The record names the file of the weights, and the file's name contains a part of its digest.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from gensim2.core.files import remove, write_atomic
from gensim2.core.foreign.tensors import Shape, read_shapes, read_tensors, require_shapes

if TYPE_CHECKING:
    import torch

FileName = Annotated[str, Field(pattern=r"^weights-[0-9a-f]{16}\.safetensors$")]
"""Name of a file that :func:`write_weights` wrote, as a field of a record."""
Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
"""SHA-256 of such a file in hexadecimal digits, as a field of a record."""


def write_weights(folder: Path, tensors: Mapping[str, torch.Tensor]) -> tuple[str, str]:
    """Write tensors atomically. Write the record next, and then call :func:`remove_other_weights`.

    Returns:
        Name of the file, and the SHA-256 of its content in hexadecimal digits.

    Raises:
        WriteError: the folder cannot be written to.
    """
    from safetensors.torch import save

    content = save(dict(tensors))
    digest = hashlib.sha256(content).hexdigest()
    name = f"weights-{digest[:16]}.safetensors"
    write_atomic(folder / name, content)
    return name, digest


def remove_other_weights(folder: Path, name: str) -> None:
    """Remove all files of weights from a folder except one.

    Raises:
        WriteError: the folder cannot be written to.
    """
    for old in folder.glob("weights-*.safetensors"):
        if old.name != name:
            remove(old)


def half_precision(network: torch.nn.Module) -> dict[str, torch.Tensor]:
    """Return the weights of a network with 16 bits each, by name. This halves the file."""
    return {name: value.detach().half().contiguous() for name, value in network.state_dict().items()}


def load_half_precision(network: torch.nn.Module, path: Path, sha256: str, max_bytes: int, remedy: str) -> None:
    """Load weights that were written with 16 bits each into a network, and set the network to evaluation mode.

    Args:
        sha256: required digest of the file's content, in hexadecimal digits.
        max_bytes: largest size of the file.
        remedy: remedy for the error message.

    Raises:
        InputError: the file is missing, damaged or too large, or belongs to another network.
    """
    expected = {name: Shape.of(value) for name, value in half_precision(network).items()}
    require_shapes(path, read_shapes(path, max_bytes, remedy), expected, remedy)
    network.load_state_dict(read_tensors(path, max_bytes, sha256, remedy))
    network.eval()

"""Turn exceptions of third-party readers about damaged files into one-line errors."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

from gensim2.core.errors import GenSim2Error, InputError


@contextlib.contextmanager
def read_by_library(file: Path, remedy: str, what: str = "cannot be read") -> Iterator[None]:
    """Turn any exception of a library call into an error that names the file.

    Every exception of the library except MemoryError counts as damage. Therefore the block should call nothing but the
    library.

    Raises:
        InputError: the library raised an exception; the message quotes the exception.
    """
    try:
        yield
    except (GenSim2Error, MemoryError):
        raise
    except Exception as error:
        said = str(error) or "no reason given"
        raise InputError(f"{what}: {type(error).__name__}: {said}", file=file, remedy=remedy) from error

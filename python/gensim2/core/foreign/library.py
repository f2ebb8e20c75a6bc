"""Errors of third-party readers about damaged files, as one line."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

from gensim2.core.errors import GenSim2Error, InputError


@contextlib.contextmanager
def read_by_library(file: Path, remedy: str, what: str = "cannot be read") -> Iterator[None]:
    """Name the file in whatever a library raises of it.

    Each reader and each compressor has errors of its own, of which their documentation lists some: all but a lack of
    memory are damage. For blocks that do nothing but call a library.

    Raises:
        InputError: with what the library said.
    """
    try:
        yield
    except (GenSim2Error, MemoryError):
        raise
    except Exception as error:
        said = str(error) or "no reason given"
        raise InputError(f"{what}: {type(error).__name__}: {said}", file=file, remedy=remedy) from error

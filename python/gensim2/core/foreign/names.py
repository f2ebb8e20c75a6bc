"""Check names that become parts of paths, columns or keys."""

from __future__ import annotations

import re
import reprlib
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator

from gensim2.core.errors import InputError

LONGEST_NAME = 100

_NAME = re.compile(rf"[A-Za-z0-9][A-Za-z0-9_.-]{{0,{LONGEST_NAME - 1}}}")

RULE = f"up to {LONGEST_NAME} letters, digits, _ - and ., a letter or digit first"


def is_name(text: str) -> bool:
    """Return whether ``text`` is a single path component on every file system: no ``..``, no slash, no leading dot."""
    return _NAME.fullmatch(text) is not None


def checked_name(text: str, *, file: Path | str | None = None, field: str | None = None) -> str:
    """Return ``text`` if it is a valid name.

    Raises:
        InputError: ``text`` is not a valid name.
    """
    if not is_name(text):
        raise InputError(f"{reprlib.repr(text)} is not a valid name", file=file, field=field, remedy=f"use {RULE}")
    return text


def _validated(text: str) -> str:
    if not is_name(text):
        raise ValueError(f"{reprlib.repr(text)} is not a valid name: use {RULE}")
    return text


Name = Annotated[str, AfterValidator(_validated)]
"""A name as a field of a record."""

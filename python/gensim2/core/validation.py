"""Turn a validation error of pydantic into an error that a user can act on."""

from __future__ import annotations

import difflib
from collections.abc import Collection
from pathlib import Path

from pydantic import ValidationError

from gensim2.core.errors import InputError


def input_error(
    error: ValidationError,
    *,
    file: Path | str | None = None,
    within: str | None = None,
    location: tuple[int | str, ...] | None = None,
    known: Collection[str] | None = None,
    remedy: str | None = None,
) -> InputError:
    """Return the first error that pydantic found as an :class:`~gensim2.core.errors.InputError`.

    Args:
        error: error of a pydantic model or a ``TypeAdapter``.
        file: file of the data.
        within: position of the data in the file, for example ``line 3``.
        location: path to the field; by default the location in pydantic's error.
        known: valid field names. If a field is unknown, the message suggests the most similar name.
        remedy: remedy for the message; the default for an unknown field is to rename or remove the field.

    Example:
        >>> from pydantic import BaseModel
        >>> class Box(BaseModel):
        ...     width: float
        >>> try:
        ...     Box(width="wide")
        ... except ValidationError as error:
        ...     print(input_error(error, file="box.json", remedy="give metres"))
        box.json: width: input should be a valid number, unable to parse string as a number (give metres)
    """
    first = error.errors()[0]
    steps = first["loc"] if location is None else location
    field = ": ".join(part for part in (within, ".".join(map(str, steps))) if part) or None
    if first["type"] == "extra_forbidden":
        alike = difflib.get_close_matches(str(steps[-1]), known or (), n=1)
        rename = f"did you mean {alike[0]!r}?" if alike else "remove it"
        return InputError("unknown field", file=file, field=field, remedy=remedy or rename)
    if first["type"] == "value_error":
        return InputError(str(first["ctx"]["error"]), file=file, field=field, remedy=remedy)
    if first["type"] in ("too_short", "too_long"):
        least = first["type"] == "too_short"
        bound, found = first["ctx"]["min_length" if least else "max_length"], first["ctx"].get("actual_length")
        entries = "entry" if bound == 1 else "entries"
        message = f"needs at {'least' if least else 'most'} {bound} {entries}" + (f", not {found}" if found else "")
        return InputError(message, file=file, field=field, remedy=remedy)
    message = first["msg"][:1].lower() + first["msg"][1:]
    return InputError(message, file=file, field=field, remedy=remedy)

"""Read JSON records in run folders; damage is reported as a one-line error."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError

from gensim2.core.errors import InputError
from gensim2.core.foreign.limits import MAX_RECORD
from gensim2.core.foreign.tree import read_input
from gensim2.core.validation import input_error

SCHEMA_VERSION = 1
"""Version of the commands' JSON output."""


class Record(BaseModel):
    """Base of the records in JSON files: no unknown fields, no type conversion, and finite numbers only."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


Model = TypeVar("Model", bound=BaseModel)
Value = TypeVar("Value")


def read_record(path: Path, model: type[Model], remedy: str) -> Model:
    """Read the JSON file ``path`` as a ``model``.

    Raises:
        InputError: the file is unreadable, not JSON or of another schema version, or it has an invalid field.
    """
    content = read_input(path, MAX_RECORD, remedy)
    return parse_record(content, TypeAdapter(model), path, remedy)


def parse_record(content: bytes, adapter: TypeAdapter[Value], path: Path, remedy: str, at: str = "") -> Value:
    """Parse JSON and validate the result with ``adapter``.

    Args:
        at: position of the JSON in the file for error messages, for example ``line 3``.

    Raises:
        InputError: as for :func:`read_record`.
    """
    try:
        # Parse with ``json`` first. Pydantic accepts NaN, and an untrusted file can make its parser very slow.
        plain = json.loads(content.decode(), parse_constant=_refuse)
        return adapter.validate_json(json.dumps(plain, allow_nan=False), strict=True)
    except ValidationError as error:
        raise input_error(error, file=path, within=at, remedy=remedy) from error
    except UnicodeDecodeError as error:
        raise InputError("is not UTF-8 text", file=path, field=at or None, remedy=remedy) from error
    except (ValueError, RecursionError) as error:
        reason = error.msg if isinstance(error, json.JSONDecodeError) else "not readable"
        where = f"line {error.lineno}" if isinstance(error, json.JSONDecodeError) and not at else at or None
        raise InputError(f"is not valid JSON: {reason}", file=path, field=where, remedy=remedy) from error


def _refuse(constant: str) -> float:
    raise ValueError(f"{constant} is not JSON")

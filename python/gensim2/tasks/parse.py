"""Convert JSON data to a :class:`~gensim2.tasks.spec.TaskSpec`; errors name the field and a remedy."""

from __future__ import annotations

import json
import types
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from gensim2.core.errors import InputError
from gensim2.core.validation import input_error
from gensim2.core.yaml_files import check_finite
from gensim2.tasks import version_1
from gensim2.tasks.spec import TaskSpec


def parse_task(data: dict[str, Any], file: str | None = None) -> TaskSpec:
    """Validate a task given as JSON data, of schema version 1 or 2.

    Args:
        data: fields of the task.
        file: file of the data, for error messages.

    Raises:
        InputError: a field is invalid.
    """
    former = version_1.is_version_1(data)
    try:
        check_finite(data, file)
        # Strict JSON mode converts lists to tuples, but rejects strings or booleans for numbers.
        text = json.dumps(version_1.upgraded(data, file) if former else data)
        return TaskSpec.model_validate_json(text, strict=True)
    except TypeError as error:  # Python types that JSON lacks
        raise InputError(f"the data contains a value of a type that JSON does not have: {error}", file=file) from error
    except RecursionError as error:
        raise InputError("the data contains itself, or is nested too deeply", file=file) from error
    except ValidationError as error:
        first = error.errors()[0]
        location, model = _walk(first["loc"])
        if former:
            location = version_1.place_of(location)
        if first["type"].startswith("union_tag"):
            location = (*location, "type")
        known = version_1.FIELDS if former and len(location) == 1 else _field_names(model)
        raise input_error(error, file=file, location=location, known=known) from error


def _walk(location: tuple[int | str, ...]) -> tuple[tuple[int | str, ...], type[BaseModel] | None]:
    """Return the file's location of a pydantic error, without added types, and the class of its last field."""
    kind: Any = TaskSpec
    shown: list[int | str] = []
    model: type[BaseModel] | None = None
    for part in location:
        kinds = _kinds(kind)
        if len(kinds) > 1:
            models = [each for each in kinds if isinstance(each, type) and issubclass(each, BaseModel)]
            if not models:
                # For several plain types, pydantic appends a type's name, which is no field in the file.
                break
            # Pydantic selects the class by this value of ``type``.
            kind = next((each for each in models if each.model_fields["type"].default == part), None)
            continue
        if part == "[key]":
            continue
        shown.append(part)
        kind = kinds[0] if kinds else None
        model = kind if isinstance(kind, type) and issubclass(kind, BaseModel) else None
        kind = _inside(kind, part)
    return tuple(shown), model


def _kinds(kind: Any) -> list[Any]:
    """Return the types that an annotation allows, with unions resolved and None left out."""
    if get_origin(kind) is Annotated:
        return _kinds(get_args(kind)[0])
    if get_origin(kind) in (Union, types.UnionType):
        return [inner for one in get_args(kind) for inner in _kinds(one)]
    return [] if kind in (None, type(None)) else [kind]


def _inside(kind: Any, part: int | str) -> Any:
    """Return the type of ``part`` (field name, key or index) of a value of the type ``kind``."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        fields = kind.model_fields
        return next((field.annotation for name, field in fields.items() if part in (name, field.alias)), None)
    arguments = get_args(kind)
    if get_origin(kind) is dict:
        return arguments[1]
    return arguments[0] if arguments else None


def _field_names(model: type[BaseModel] | None) -> list[str]:
    return [] if model is None else [field.alias or name for name, field in model.model_fields.items()]

"""The task library: one folder of data a task, read through the package so that a wheel carries it.

``library/<Name>/task.yaml`` is a :class:`~gensim2.tasks.spec.TaskSpec`, ``library/<Name>/solver.yaml`` the
solver config that solves it.
"""

from __future__ import annotations

import difflib
import json
import math
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from gensim2.errors import InputError
from gensim2.tasks.spec import TaskSpec


class _UniqueKeyLoader(yaml.SafeLoader):
    """Safe YAML in which a key given twice is an error: YAML itself would silently keep the last."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        for index, key in enumerate(keys):
            if key in keys[:index]:
                raise yaml.constructor.ConstructorError(
                    None, None, f"field {key!r} is given twice", node.value[index][0].start_mark
                )
        return super().construct_mapping(node, deep=deep)


def _folder() -> Traversable:
    return files("gensim2.tasks") / "library"


@cache
def task_names() -> tuple[str, ...]:
    """Names of the tasks in the library, sorted."""
    return tuple(
        sorted(entry.name for entry in _folder().iterdir() if entry.is_dir() and (entry / "task.yaml").is_file())
    )


def _known(name: str) -> str:
    if name in task_names():
        return name
    by_lower = {known.lower(): known for known in task_names()}
    near = [by_lower[match] for match in difflib.get_close_matches(name.lower(), by_lower, n=3, cutoff=0.5)]
    remedy = f"did you mean {', '.join(near)}?" if near else f"known: {', '.join(task_names())}"
    raise InputError(f"unknown task {name!r}", remedy=remedy)


@cache
def load_task(name: str) -> TaskSpec:
    """The spec of a library task.

    Raises:
        InputError: there is no such task; names near matches.
    """
    source = _folder() / _known(name) / "task.yaml"
    task = _parse_task(source.read_text(encoding="utf-8"), str(source))
    if task.name != name:
        raise InputError(f"is {task.name!r} in the folder {name!r}", file=str(source), field="name")
    return task


def load_config(name: str) -> dict[str, Any]:
    """The solver config of a library task, as plain data.

    Raises:
        InputError: there is no such task, or it has no solver config.
    """
    source = _folder() / _known(name) / "solver.yaml"
    if not source.is_file():
        raise InputError("the task has no solver config", file=str(source))
    return _mapping(source.read_text(encoding="utf-8"), str(source))


def load_task_file(path: Path) -> TaskSpec:
    """The spec in a YAML (or JSON) file.

    Raises:
        InputError: the file cannot be read, is not YAML, or a field is unknown, missing or out of range.
    """
    return _parse_task(_read(path), str(path))


def load_config_file(path: Path) -> dict[str, Any]:
    """The solver config in a YAML (or JSON) file, as plain data; numbers are finite.

    Raises:
        InputError: the file cannot be read, is not YAML, or holds NaN or infinity.
    """
    return _mapping(_read(path), str(path))


def parse_task(data: dict[str, Any], file: str | None = None) -> TaskSpec:
    """Validate a task given as plain data.

    Raises:
        InputError: names the field that is wrong.
    """
    _finite(data, file, "")
    try:
        # Strict JSON mode: lists become tuples, but a string or a bool does not pass for a number.
        return TaskSpec.model_validate_json(json.dumps(data), strict=True)
    except TypeError as error:  # YAML knows dates and sets, JSON does not
        raise InputError(f"holds a value of an unusable type: {error}", file=file) from error
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(str(part) for part in first["loc"]) or None
        if first["type"] == "extra_forbidden":
            known = TaskSpec.model_fields if len(first["loc"]) == 1 else None
            near = difflib.get_close_matches(str(first["loc"][-1]), known or (), n=1)
            remedy = f"did you mean {near[0]!r}?" if near else "remove it"
            raise InputError("unknown field", file=file, field=field, remedy=remedy) from error
        raise InputError(first["msg"].lower(), file=file, field=field) from error


def _parse_task(text: str, file: str) -> TaskSpec:
    return parse_task(_mapping(text, file), file)


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot read: {error.strerror}", file=path) from error
    except UnicodeDecodeError as error:
        raise InputError("is not UTF-8 text", file=path) from error


def _mapping(text: str, file: str) -> dict[str, Any]:
    try:
        data = yaml.load(text, Loader=_UniqueKeyLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"line {mark.line + 1}" if mark else None
        raise InputError(f"is not valid YAML: {error.problem}", file=file, field=where) from error
    except (yaml.YAMLError, RecursionError) as error:
        raise InputError("is not valid YAML", file=file) from error
    if not isinstance(data, dict) or not all(isinstance(key, str) for key in data):
        raise InputError("must hold fields by name", file=file)
    _finite(data, file, "")
    return data


def _finite(value: Any, file: str | None, field: str) -> None:
    if isinstance(value, float) and not math.isfinite(value):
        raise InputError(f"must be a finite number, is {value}", file=file, field=field)
    if isinstance(value, dict):
        for key, item in value.items():
            _finite(item, file, f"{field}.{key}" if field else str(key))
    elif isinstance(value, (list, tuple)):
        for index, item in enumerate(value):
            _finite(item, file, f"{field}.{index}" if field else str(index))

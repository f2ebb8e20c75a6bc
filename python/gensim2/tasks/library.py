"""The task library: one folder of data a task, read through the package so that a wheel carries it.

``library/<Name>/task.yaml`` is a :class:`~gensim2.tasks.spec.TaskSpec`, ``library/<Name>/solver.yaml`` the
solver config that solves it.
"""

from __future__ import annotations

import difflib
import json
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from gensim2.errors import InputError
from gensim2.tasks.spec import TaskSpec
from gensim2.yaml_files import check_finite, parse_yaml, read_yaml


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
    task = parse_task(parse_yaml(source.read_bytes(), str(source)), str(source))
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
    return parse_yaml(source.read_bytes(), str(source))


def load_task_file(path: Path) -> TaskSpec:
    """The spec in a YAML (or JSON) file.

    Raises:
        InputError: the file cannot be read, is not YAML, or a field is unknown, missing or out of range.
    """
    return parse_task(read_yaml(path), str(path))


def load_config_file(path: Path) -> dict[str, Any]:
    """The solver config in a YAML (or JSON) file, as plain data; numbers are finite.

    Raises:
        InputError: the file cannot be read, is not YAML, or holds NaN or infinity.
    """
    return read_yaml(path)


def parse_task(data: dict[str, Any], file: str | None = None) -> TaskSpec:
    """Validate a task given as plain data.

    Raises:
        InputError: names the field that is wrong.
    """
    try:
        check_finite(data, file)
        # Strict JSON mode: lists become tuples, but a string or a bool does not pass for a number.
        return TaskSpec.model_validate_json(json.dumps(data), strict=True)
    except TypeError as error:  # Python knows more than JSON
        raise InputError(f"holds a value of an unusable type: {error}", file=file) from error
    except RecursionError as error:
        raise InputError("holds itself, or too many values inside each other", file=file) from error
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(str(part) for part in first["loc"]) or None
        if first["type"] == "extra_forbidden":
            known = TaskSpec.model_fields if len(first["loc"]) == 1 else None
            near = difflib.get_close_matches(str(first["loc"][-1]), known or (), n=1)
            remedy = f"did you mean {near[0]!r}?" if near else "remove it"
            raise InputError("unknown field", file=file, field=field, remedy=remedy) from error
        raise InputError(first["msg"].lower(), file=file, field=field) from error

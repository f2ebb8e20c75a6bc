"""Convert a stored task to task code, which serves as an example for a language model."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from gensim2.core.errors import InputError
from gensim2.design.sandbox.allow_list import MODULE
from gensim2.design.sandbox.language import CRITERIA, METHODS, SETTINGS
from gensim2.tasks.criteria import Criterion
from gensim2.tasks.spec import HAND, ObjectSpec, Step, TaskSpec

WIDTH = 100


def task_code(task: TaskSpec) -> str:
    """Return a program that describes a task, in the language of ``language.py``.

    :func:`~gensim2.design.sandbox.run_task_code` turns the program into the same task, without its provenance.

    Raises:
        InputError: an object has the name of a method or setting of the language.
    """
    for name in sorted({*METHODS, *SETTINGS}.intersection(task.objects)):
        raise InputError(f"task code cannot contain an object named {name!r}", field="objects")
    body = ["# Its objects: each is called as the attribute that it is given to, and loaded by its class."]
    for name, thing in task.objects.items():
        body += _object(name, thing, task)
    body += ["", "# Its steps, in order: what each acts on, and what must hold once when it is done."]
    for step in task.steps:
        body += _step(step, task)
    if task.goal is not None:
        body += ["", "# Success: what must hold at the end, all of it."]
        body += _call("self.goal", [_criterion(one, task) for one in task.goal])
    offered = ("Object", "Place", "Randomization", *CRITERIA)
    used = [name for name in offered if any(f"{name}(" in line for line in body)]
    return "\n".join(
        [
            *_import([*used, "Task"]),
            "",
            "",
            f"class {task.name}(Task):",
            f"    description = {_literal(task.description)}",
            f"    max_episode_steps = {task.max_episode_steps}",
            "",
            "    def __init__(self):",
            *(f"        {line}" if line else "" for line in body),
            "",
        ]
    )


def _object(name: str, thing: ObjectSpec, task: TaskSpec) -> list[str]:
    given = thing.model_dump(mode="json", exclude_defaults=True)
    arguments = [_literal(given.pop("class"))]
    if "instances" in given:
        arguments.append(f"instances={_literal(given['instances'])}")
    if "place" in given:
        arguments.append(f"place={_fields('Place', given['place'], task)}")
    if "randomization" in given:
        arguments.append(f"randomization={_fields('Randomization', given['randomization'], task)}")
    return _call(f"self.{name} = Object", arguments)


def _step(step: Step, task: TaskSpec) -> list[str]:
    arguments = [_literal(step.name), f"self.{step.object}"]
    if step.tool != HAND:
        arguments.append(f"tool=self.{step.tool}")
    if step.strategies != (step.name,):
        arguments.append(f"strategies={_literal(list(step.strategies))}")
    if step.done:
        arguments.append(f"done=[{', '.join(_criterion(one, task) for one in step.done)}]")
    return _call("self.step", arguments)


def _criterion(criterion: Criterion, task: TaskSpec) -> str:
    fields = criterion.model_dump(mode="json")
    return _fields(fields.pop("type"), fields, task)


def _fields(name: str, fields: dict[str, Any], task: TaskSpec) -> str:
    given = (f"{field}={_reference(value, task)}" for field, value in fields.items() if value is not None)
    return f"{name}({', '.join(given)})"


def _reference(value: Any, task: TaskSpec) -> str:
    return f"self.{value}" if isinstance(value, str) and value in task.objects else _literal(value)


def _literal(value: Any) -> str:
    """Return the source code of a value, with texts in double quotes."""
    if isinstance(value, str):
        return '"' + repr(f"'{value}")[2:-1] + '"'
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_literal(key)}: {_literal(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, list):
        numbers = bool(value) and all(isinstance(inner, int | float) for inner in value)
        inside = ", ".join(map(_literal, value))
        return f"({inside}{',' if len(value) == 1 else ''})" if numbers else f"[{inside}]"
    return repr(value)


def _call(function: str, arguments: Sequence[str]) -> list[str]:
    line = f"{function}({', '.join(arguments)})"
    return [line] if len(line) <= WIDTH else _in_brackets(f"{function}(", arguments)


def _import(names: Sequence[str]) -> list[str]:
    line = f"from {MODULE} import {', '.join(names)}"
    return [line] if len(line) <= WIDTH else _in_brackets(f"from {MODULE} import (", names)


def _in_brackets(start: str, parts: Iterable[str]) -> list[str]:
    return [start, *(f"    {part}," for part in parts), ")"]

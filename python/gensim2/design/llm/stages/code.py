"""Ask the model to write a proposed task as code.

The package :mod:`gensim2.design.sandbox` interprets the code. The resulting task must agree with the proposed task.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from gensim2.design.llm.conversations import Ask, Wrong
from gensim2.design.llm.extraction import Data
from gensim2.design.llm.templating import Prompts
from gensim2.design.sandbox import run_task_code
from gensim2.tasks.spec import TaskSpec

#: Number of stored tasks whose code is shown as an example.
REFERENCES = 2

#: Maximum number of characters of generated code.
MAX_CHARACTERS = 20_000

_BLOCK = re.compile(r"```[^\n]*\n(.*?)```", re.DOTALL)


def code(prompts: Prompts, task: TaskSpec, references: Sequence[tuple[str, str]]) -> Ask[TaskSpec]:
    """Return the prompt that asks the model to write a task as code.

    Args:
        task: task that the code must describe.
        references: name and code of stored tasks, as examples.
    """
    text = prompts.text(
        "code",
        name=task.name,
        description=task.description,
        references=[{"name": name, "code": source.strip()} for name, source in references],
        task=_told(task),
    )
    schema = {"type": "object", "properties": {"code": {"type": "string"}}, "required": ["code"]}
    return Ask("code", task.name, "", text, schema, lambda data: read_code(data, task), prose=True)


def read_code(data: Sequence[Data], task: TaskSpec) -> TaskSpec:
    """Return the task that the generated class describes: ``task``, possibly with other placements.

    Raises:
        Wrong: the code is too long or describes a different task.
        TaskCodeError: the code cannot be interpreted.
    """
    text = str(data[0]["text"])
    blocks = _BLOCK.findall(text)
    source = max(blocks, key=len) if blocks else text
    if len(source) > MAX_CHARACTERS:
        raise Wrong([f"the code is longer than {MAX_CHARACTERS} characters"])
    found = run_task_code(source)
    problems = [
        f"{what} is {was!r} and must be {wanted!r}"
        for what, was, wanted in (
            ("the class's name", found.name, task.name),
            ("the objects", _classes(found), _classes(task)),
            ("the steps", _steps(found), _steps(task)),
            ("the goal", [c.type for c in found.success], [c.type for c in task.success]),
        )
        if was != wanted
    ]
    if problems:
        raise Wrong(problems)
    return found


def _told(task: TaskSpec) -> dict[str, object]:
    return {
        "description": task.description,
        "objects": {name: thing.asset_class for name, thing in task.objects.items()},
        "steps": [
            {
                "name": step.name,
                "object": step.object,
                "tool": step.tool,
                "done": [criterion.model_dump(mode="json") for criterion in step.done],
            }
            for step in task.steps
        ],
        "goal": [criterion.model_dump(mode="json") for criterion in task.success],
    }


def _classes(task: TaskSpec) -> list[str]:
    return [thing.asset_class for thing in task.objects.values()]


def _steps(task: TaskSpec) -> list[str]:
    return [f"{step.name} ({', '.join(criterion.type for criterion in step.done)})" for step in task.steps]

"""The task as code: a generated class, which runs in a sandbox and has to come to the same task."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

from gensim2.design.llm.conversations import Ask, Wrong
from gensim2.design.llm.extraction import Data
from gensim2.design.llm.templating import Prompts
from gensim2.tasks.spec import TaskSpec

#: Tasks whose code is shown for reference.
REFERENCES = 2

#: Characters of the longest code that is looked at.
MAX_CHARACTERS = 20_000

_BLOCK = re.compile(r"```[^\n]*\n(.*?)```", re.DOTALL)


def code(
    prompts: Prompts,
    task: TaskSpec,
    references: Sequence[tuple[str, str]],
    run: Callable[[str], TaskSpec],
) -> Ask[TaskSpec]:
    """Ask for a task's class.

    Args:
        references: name and code of tasks that are there.
        run: what a class says, from a sandbox.
    """
    text = prompts.text(
        "code",
        name=task.name,
        description=task.description,
        references=[{"name": name, "code": source.strip()} for name, source in references],
        task=_told(task),
    )
    schema = {"type": "object", "properties": {"code": {"type": "string"}}, "required": ["code"]}
    return Ask("code", task.name, "", text, schema, lambda data: read_code(data, task, run), prose=True)


def read_code(data: Sequence[Data], task: TaskSpec, run: Callable[[str], TaskSpec]) -> TaskSpec:
    """The task that a generated class stands for, which must be ``task``; its objects may stand elsewhere.

    Raises:
        Wrong: there is no code, or it says something else.
        InputError: the sandbox refuses the code, or it fails there.
    """
    text = str(data[0]["text"])
    blocks = _BLOCK.findall(text)
    source = max(blocks, key=len) if blocks else text
    if len(source) > MAX_CHARACTERS:
        raise Wrong([f"the code is longer than {MAX_CHARACTERS} characters"])
    found = run(source)
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

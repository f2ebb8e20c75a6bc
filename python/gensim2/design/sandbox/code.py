"""From generated task code to a task."""

from __future__ import annotations

import typing
from functools import cache
from typing import Any, Literal

from gensim2.design.sandbox.box import Ended, Sandbox, sandbox, to_json_value
from gensim2.errors import InputError
from gensim2.tasks.criteria import Criterion
from gensim2.tasks.parse import parse_task
from gensim2.tasks.spec import TaskSpec

Kind = Literal["syntax", "refused", "failed", "timeout", "invalid"]


#: Of what a program says of itself: sentences, and characters of each.
MAX_PROBLEMS, LONGEST_PROBLEM = 10, 600


class TaskCodeError(InputError):
    """Generated task code cannot be used; the message can go back to whoever wrote it.

    Attributes:
        kind: ``"syntax"``: it is no Python; ``"refused"``: it does what generated code may not; ``"failed"``: it
            raised, or its process ended; ``"timeout"``: it used up its time or its room; ``"invalid"``: it describes
            no valid task.
        problems: one sentence each, with the line where there is one.
    """

    def __init__(self, kind: Kind, problems: tuple[str, ...]) -> None:
        super().__init__("; ".join(problems), field="task code")
        self.kind, self.problems = kind, problems


def run_task_code(source: str, within: Sandbox | None = None) -> TaskSpec:
    """The task that a program in the language of ``inside/task_code.py`` describes.

    The program is looked at and run in the sandbox only; what comes back is JSON, and is checked like a file.

    Args:
        source: the program: one class derived from ``Task``.
        within: the sandbox; default: that of this machine.

    Raises:
        TaskCodeError: the program cannot be used; says why, by line.
        NoSandboxError: this machine has no sandbox.
    """
    ended = (within or sandbox()).run(source, criterion_arguments())
    found = to_json_value(ended)
    if not isinstance(found, dict) or ended.why is not None or ended.code != 0:
        raise _of_its_end(ended)
    if "task" not in found:
        kind: Any = found.get("kind")
        problems = found.get("problems")
        known: Kind = kind if kind in typing.get_args(Kind) else "failed"
        told = problems[:MAX_PROBLEMS] if isinstance(problems, list) else ["it failed"]
        raise TaskCodeError(known, tuple(str(problem)[:LONGEST_PROBLEM] for problem in told))
    fields = found["task"]
    if not isinstance(fields, dict):
        raise TaskCodeError("invalid", ("it describes no task",))
    fields.pop("provenance", None)  # not for a program to say
    try:
        return parse_task(fields)
    except InputError as error:
        raise TaskCodeError("invalid", (str(error),)) from error


def _of_its_end(ended: Ended) -> TaskCodeError:
    if ended.why is not None:
        return TaskCodeError("timeout", (ended.why,))
    if ended.code < 0 or ended.code > 128:  # bubblewrap says 128 + n of a signal
        number = -ended.code if ended.code < 0 else ended.code - 128
        return TaskCodeError("timeout", (f"its process was stopped by signal {number}: too much time or memory",))
    return TaskCodeError("failed", (f"its process ended with {ended.code} and no answer",))


@cache
def criterion_arguments() -> dict[str, list[str]]:
    """Arguments of each type of criterion, in order."""
    union = typing.get_args(Criterion)[0]
    return {
        model.model_fields["type"].default: [name for name in model.model_fields if name != "type"]
        for model in typing.get_args(union)
    }

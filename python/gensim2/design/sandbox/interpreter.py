"""Build a task from generated task code.

The interpreter evaluates the syntax tree of the code, statement by statement. Python itself never executes the code.
"""

from __future__ import annotations

import ast
from collections import ChainMap
from collections.abc import Mapping, MutableMapping, Sequence
from typing import Any, Literal

from gensim2.core.errors import InputError
from gensim2.design.sandbox.allow_list import Refused, checked, is_super_init, number
from gensim2.design.sandbox.language import METHODS, OFFERED, Task
from gensim2.tasks.parse import parse_task
from gensim2.tasks.spec import TaskSpec

Kind = Literal["syntax", "refused", "failed", "invalid"]

#: Maximum number of characters in the message of a problem.
LONGEST_PROBLEM = 600


class TaskCodeError(InputError):
    """Generated task code cannot be used; the message can be sent back to the model that wrote the code.

    Attributes:
        kind: ``"syntax"``: the code is not Python; ``"refused"``: a construct is forbidden; ``"failed"``: a name is
            wrong; ``"invalid"``: the task is invalid.
        problems: one sentence for each fault, with the line if known.
    """

    def __init__(self, kind: Kind, problems: Sequence[str]) -> None:
        self.kind, self.problems = kind, tuple(problem[:LONGEST_PROBLEM] for problem in problems)
        super().__init__("; ".join(self.problems), field="task code")


def run_task_code(source: str) -> TaskSpec:
    """Return the task that a program describes; its fields are checked like the fields of a task file.

    Args:
        source: the program: one class derived from ``Task`` (docs/reference/sandbox.md).

    Raises:
        TaskCodeError: the program cannot be used; the message names the lines.

    Example:
        >>> from gensim2.tasks import load_task
        >>> run_task_code(task_code(load_task("OpenBox"))).name
        'OpenBox'
    """
    try:
        tree, found = checked(source, OFFERED, METHODS)
    except SyntaxError as error:
        where = f"line {error.lineno}: " if error.lineno else ""
        raise TaskCodeError("syntax", (f"{where}{error.msg}",)) from error
    if found:
        raise TaskCodeError("refused", [f"line {line}: {words}" for line, words in found])
    try:
        return parse_task(interpret(tree))
    except Refused as error:
        raise TaskCodeError("refused", (f"line {error.line}: {error.words}",)) from error
    except TaskCodeError:
        raise
    except InputError as error:
        raise TaskCodeError("invalid", (str(error),)) from error


def interpret(tree: ast.Module) -> dict[str, Any]:
    """Return the fields of the task that a syntax tree describes.

    Args:
        tree: syntax tree that the allow-list accepts. Only assignments, calls of the language's functions and constants
            are evaluated.

    Raises:
        Refused: the tree has a node that is not in the language.
        TaskCodeError: a call or a name is wrong.
    """
    names: dict[str, Any] = {}
    found: tuple[ast.ClassDef, Task, Sequence[ast.stmt]] | None = None
    for statement in tree.body:
        if isinstance(statement, ast.ImportFrom):
            names.update((alias.name, _known(alias.name, OFFERED, statement)) for alias in statement.names)
        elif isinstance(statement, ast.ClassDef):
            members: dict[str, Any] = {}
            body: Sequence[ast.stmt] = ()
            for inner in statement.body:
                if isinstance(inner, ast.FunctionDef):
                    body = inner.body
                else:
                    _run(inner, ChainMap(members, names))
            found = statement, Task(members), body
        else:
            _run(statement, names)
    if found is None:
        raise Refused(tree, "there must be one class, derived from Task")
    node, task, body = found
    scope = ChainMap({"self": task}, names)
    for statement in body:
        _run(statement, scope)
    try:
        return task.fields(node.name, ast.get_docstring(node, clean=False))
    except ValueError as error:
        raise TaskCodeError("failed", (f"ValueError: {error}",)) from error


def _run(statement: ast.stmt, names: MutableMapping[str, Any]) -> None:
    match statement:
        case ast.Pass():
            pass
        case ast.Expr(value=value):
            _value(value, names)
        case ast.Assign(targets=[ast.Name(id=name)], value=value):
            names[name] = _value(value, names)
        case ast.Assign(targets=[ast.Attribute(value=owner, attr=name) as target], value=value):
            given = _value(value, names)
            try:
                _self(owner, names).set(name, given)
            except ValueError as error:
                raise _failed(target, error) from error
        case _:
            raise Refused(statement, "this statement is not allowed")


def _value(node: ast.AST, names: Mapping[str, Any]) -> Any:
    match node:
        case ast.Constant(value=value) if value is None or isinstance(value, (str, int, float)):
            return value
        case ast.Name(id=name):
            return _known(name, names, node)
        case ast.Attribute(value=owner, attr=name):
            try:
                return _self(owner, names).get(name)
            except AttributeError as error:
                raise _failed(node, error) from error
        case ast.List(elts=parts):
            return [_value(part, names) for part in parts]
        case ast.Tuple(elts=parts):
            return tuple(_value(part, names) for part in parts)
        case ast.Dict(keys=keys, values=values):
            texts = [key.value if isinstance(key, ast.Constant) else None for key in keys]
            if all(isinstance(text, str) for text in texts):
                return {text: _value(value, names) for text, value in zip(texts, values, strict=True)}
        case ast.UnaryOp() | ast.BinOp():
            return number(node)
        case ast.Call(func=ast.Attribute() as called) if is_super_init(called, node):
            _known("self", names, node)
            return None
        case ast.Call():
            return _called(node, names)
    raise Refused(node, "this expression is not allowed")


def _called(node: ast.Call, names: Mapping[str, Any]) -> Any:
    """Call a function of the task language; programs cannot call anything else."""
    function = _value(node.func, names)
    given = [_value(argument, names) for argument in node.args]
    named = {str(keyword.arg): _value(keyword.value, names) for keyword in node.keywords}
    try:
        return function(*given, **named)
    except (TypeError, ValueError) as error:
        raise _failed(node, error) from error


def _self(owner: ast.expr, names: Mapping[str, Any]) -> Task:
    if not (isinstance(owner, ast.Name) and owner.id == "self"):
        raise Refused(owner, "only attributes of self may be used")
    found = _known("self", names, owner)
    if not isinstance(found, Task):
        raise Refused(owner, "the name 'self' cannot be assigned")
    return found


def _known(name: str, names: Mapping[str, Any], node: ast.AST) -> Any:
    if name not in names:
        raise _failed(node, NameError(f"name {name!r} is not defined"))
    return names[name]


def _failed(node: ast.AST, error: Exception) -> TaskCodeError:
    line = getattr(node, "lineno", 1)
    return TaskCodeError("failed", (f"line {line}: {type(error).__name__}: {error}",))

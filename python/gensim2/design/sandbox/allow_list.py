"""Check generated task code against an allow-list of syntax nodes.

Any construct that is not on the list is refused; the error gives its line.
"""

from __future__ import annotations

import ast
import math
import operator
import re
import warnings
from collections.abc import Callable, Collection

MODULE = "task_code"
TOO_MANY_BITS = "a whole number of more than 64 bits"
NOT_FINITE = "a number that is not finite"
BASE = "Task"

LONGEST_SOURCE = 100_000
MAX_NODES = 5_000
#: Maximum depth of the syntax tree; a task needs about 15.
MAX_DEPTH = 50
MAX_PROBLEMS = 10

#: Syntax nodes that are always allowed, because they have no field that could be harmful.
PLAIN = (
    ast.Module,
    ast.Expr,
    ast.Pass,
    ast.Load,
    ast.Store,
    ast.arguments,
    ast.arg,
    ast.keyword,
    ast.List,
    ast.Tuple,
    ast.Dict,
    ast.operator,
    ast.unaryop,
)
OPERATORS: dict[type[ast.AST], Callable[..., int | float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
}
CONSTANTS = (str, int, float, bool, type(None))
#: Readable names of node types.
SPOKEN = {
    ast.JoinedStr: "an f-string",
    ast.ListComp: "a list comprehension",
    ast.SetComp: "a set comprehension",
    ast.DictComp: "a dict comprehension",
    ast.GeneratorExp: "a generator",
    ast.AugAssign: "an assignment such as +=",
    ast.AnnAssign: "an assignment with a type",
    ast.NamedExpr: "an assignment inside an expression",
    ast.Subscript: "an index",
    ast.IfExp: "a conditional expression",
}
#: Maximum absolute value of an integer.
LARGEST = 2**63
#: If the parser gives no line for deep nesting, the message names the longest line above ``LONG_LINE`` characters.
LONG_LINE = 200
NOT_IN_TEXT = re.compile("[\0\ud800-\udfff]")
NAME = re.compile(r"[a-z][a-z0-9_]*")
CLASS_NAME = re.compile(r"[A-Z][A-Za-z0-9]*")


class Refused(Exception):
    """A program contains a construct that is not allowed."""

    def __init__(self, node: ast.AST | None, words: str) -> None:
        super().__init__(words)
        self.line: int = getattr(node, "lineno", 1)
        self.words = words


def checked(
    source: str, offered: Collection[str], methods: Collection[str]
) -> tuple[ast.Module, list[tuple[int, str]]]:
    """Parse a program and list its forbidden constructs.

    Args:
        source: the program.
        offered: names that the program may import.
        methods: methods of ``self`` that the program may call.

    Returns:
        The syntax tree, and up to ten forbidden constructs as pairs of line number and sentence. The list is empty if
        all is allowed.

    Raises:
        SyntaxError: the program is not Python, or too long or nested too deeply for the parser.
    """
    if len(source) > LONGEST_SOURCE:
        raise SyntaxError(f"the program has {len(source)} characters, more than {LONGEST_SOURCE}")
    if (odd := NOT_IN_TEXT.search(source)) is not None:
        raise at_line(f"the program contains a control character ({odd[0]!r})", source.count("\n", 0, odd.start()) + 1)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Ignore warnings, for example about unknown escapes in a description.
            tree = ast.parse(source)
    except SyntaxError as error:
        if "integer string conversion" in str(error.msg):
            raise at_line(TOO_MANY_BITS, error.lineno) from error
        raise
    except (RecursionError, MemoryError) as error:
        raise at_line("cannot be parsed: the program is nested too deeply", longest_line(source)) from error
    except ValueError as error:
        raise SyntaxError(f"the program cannot be parsed: {error}") from error
    return tree, Reader(offered, methods).read(tree)


def at_line(words: str, line: int | None) -> SyntaxError:
    """Return a SyntaxError with a message and a line number."""
    return SyntaxError(words, (None, line, None, None))


def longest_line(source: str) -> int | None:
    """Return the number of the longest line if it is too long, else None."""
    lengths = [len(line) for line in source.split("\n")]
    return lengths.index(max(lengths)) + 1 if max(lengths) > LONG_LINE else None


class Reader:
    """Checks each node of a program's syntax tree."""

    def __init__(self, offered: Collection[str], methods: Collection[str]) -> None:
        self.offered, self.methods = offered, methods
        self.found: list[tuple[int, str]] = []
        self.known = {"self"}

    def read(self, tree: ast.Module) -> list[tuple[int, str]]:
        try:
            nodes, parents = self.listed(tree)
        except Refused as refused:
            return [(refused.line, refused.words)]
        # The nodes are in program order, so that a name counts as defined only after its assignment.
        for node in nodes:
            try:
                self.look(node, parents.get(node))
            except Refused as refused:
                self.found.append((refused.line, refused.words))
        classes = [node for node in tree.body if isinstance(node, ast.ClassDef)]
        if len(classes) != 1:
            self.found.append((1, f"there must be one class, derived from {BASE}; there are {len(classes)}"))
        return sorted(set(self.found))[:MAX_PROBLEMS]

    def listed(self, tree: ast.Module) -> tuple[list[ast.AST], dict[ast.AST, ast.AST]]:
        """Return all nodes in program order, and the parent of each node.

        The method uses a loop instead of recursion, because deep nesting could exceed Python's recursion limit.

        Raises:
            Refused: the program has too many nodes, or they are nested too deeply.
        """
        nodes: list[ast.AST] = []
        parents: dict[ast.AST, ast.AST] = {}
        waiting: list[tuple[ast.AST, int]] = [(tree, 0)]
        while waiting:
            node, depth = waiting.pop()
            nodes.append(node)
            if len(nodes) > MAX_NODES:
                raise Refused(None, f"the program has more than {MAX_NODES} syntax nodes")
            if depth > MAX_DEPTH:
                raise Refused(node, "the program is nested too deeply")
            children = list(ast.iter_child_nodes(node))
            # Visit the value before the name, because Python evaluates them in this order.
            if isinstance(node, ast.Assign):
                children = [node.value, *node.targets]
            for child in children:
                parents.setdefault(child, node)
            waiting.extend((child, depth + 1) for child in reversed(children))
        return nodes, parents

    def look(self, node: ast.AST, parent: ast.AST | None) -> None:
        method = getattr(self, f"look_at_{type(node).__name__}", None)
        if method is not None:
            method(node, parent)
        elif isinstance(node, (ast.operator, ast.unaryop)) and type(node) not in OPERATORS:
            raise Refused(parent, f"the operator {type(node).__name__} is not allowed")
        elif not isinstance(node, PLAIN):
            at = node if hasattr(node, "lineno") else parent
            raise Refused(at, f"{_spoken(node)} is not allowed")

    def look_at_ImportFrom(self, node: ast.ImportFrom, parent: ast.AST | None) -> None:
        module = "." * node.level + (node.module or "")
        if module != MODULE:
            raise Refused(node, f"imports from {_short(module)} are not allowed; import only from {MODULE}")
        if not isinstance(parent, ast.Module):
            raise Refused(node, "an import must be at the top level of the program")
        for alias in node.names:
            if alias.name not in self.offered:
                raise Refused(
                    node,
                    f"{MODULE} has no {_short(alias.name)}; a program can import {', '.join(sorted(self.offered))}",
                )
            if alias.asname is not None:
                raise Refused(node, "an import with 'as' is not allowed")
            self.known.add(alias.name)

    def look_at_alias(self, node: ast.alias, parent: ast.AST | None) -> None:
        if not isinstance(parent, ast.ImportFrom):
            raise Refused(parent, f'import {_short(node.name)} is not allowed; write "from {MODULE} import NAME"')

    def look_at_Import(self, node: ast.Import, parent: ast.AST | None) -> None:
        """Do nothing: ``look_at_alias`` checks each module."""

    def look_at_ClassDef(self, node: ast.ClassDef, parent: ast.AST | None) -> None:
        if not isinstance(parent, ast.Module):
            raise Refused(node, "a class must be at the top level of the program")
        if node.decorator_list:
            raise Refused(node, "a decorator is not allowed")
        if not CLASS_NAME.fullmatch(node.name):
            raise Refused(
                node, f"the name of a class must be CamelCase in ASCII letters and digits, not {_short(node.name)}"
            )
        bases = [base.id if isinstance(base, ast.Name) else None for base in node.bases]
        if bases != [BASE] or node.keywords:
            raise Refused(node, f"a class must be derived from {BASE} and from nothing else")

    def look_at_FunctionDef(self, node: ast.FunctionDef, parent: ast.AST | None) -> None:
        if not isinstance(parent, ast.ClassDef) or node.name != "__init__":
            raise Refused(node, f"the only function in a program is __init__ of the class, not {_short(node.name)}")
        given = node.args
        others = (given.posonlyargs, given.kwonlyargs, given.vararg, given.kwarg, given.defaults)
        if [arg.arg for arg in given.args] != ["self"] or any(others):
            raise Refused(node, "__init__ must have the parameter self and no others")
        if node.decorator_list:
            raise Refused(node, "a decorator is not allowed")

    def look_at_Assign(self, node: ast.Assign, parent: ast.AST | None) -> None:
        if not isinstance(parent, (ast.ClassDef, ast.FunctionDef)):
            raise Refused(node, "an assignment outside the class is not allowed")
        if len(node.targets) != 1 or not isinstance(node.targets[0], (ast.Name, ast.Attribute)):
            raise Refused(node, "the left side of an assignment must be one name or one attribute of self")

    def look_at_Attribute(self, node: ast.Attribute, parent: ast.AST | None) -> None:
        if is_super_init(node, parent):
            return
        if not (isinstance(node.value, ast.Name) and node.value.id == "self"):
            only = "only attributes of self may be used"
            raise Refused(node, f"the attribute {_short(node.attr)} is not allowed, because {only}")
        if not NAME.fullmatch(node.attr):
            raise Refused(
                node,
                f"self.{_short(node.attr)} is not allowed: names consist of lower-case ASCII letters, digits and _",
            )
        if isinstance(node.ctx, ast.Store) and node.attr in self.methods:
            raise Refused(node, f"self.{node.attr} cannot be assigned, because it is a method of {BASE}")

    def look_at_Name(self, node: ast.Name, parent: ast.AST | None) -> None:
        if isinstance(node.ctx, ast.Store):
            if not NAME.fullmatch(node.id) or node.id in self.offered or node.id in ("self", "super"):
                raise Refused(node, f"the name {_short(node.id)} cannot be assigned")
            self.known.add(node.id)
        elif node.id == "super" and isinstance(parent, ast.Call) and parent.func is node:
            return  # look_at_Call checks where super() occurs
        elif node.id not in self.known:
            raise Refused(node, f"the name {_short(node.id)} is not allowed or was not imported from {MODULE}")

    def look_at_Call(self, node: ast.Call, parent: ast.AST | None) -> None:
        called = node.func
        if any(keyword.arg is None for keyword in node.keywords):
            raise Refused(node, "** in a call is not allowed")
        named = [keyword.arg for keyword in node.keywords]
        if (again := next((name for name in named if named.count(name) > 1), None)) is not None:
            raise Refused(node, f"the argument {_short(str(again))} is given twice")
        if isinstance(called, ast.Name) and called.id == "super":
            if not (isinstance(parent, ast.Attribute) and parent.attr == "__init__") or node.args or node.keywords:
                raise Refused(node, "super is allowed in super().__init__() only")
        elif isinstance(called, ast.Attribute):
            if is_super_init(called, node):
                if node.args or node.keywords:
                    raise Refused(node, "super().__init__() takes nothing")
            elif called.attr not in self.methods:
                only = f"only these methods may be called: {self.offer()}"
                raise Refused(node, f"a call of .{_short(called.attr)} is not allowed; {only}")
        elif not isinstance(called, ast.Name):
            raise Refused(node, "only a function given by its name can be called")
        elif called.id not in self.offered or called.id == BASE:
            raise Refused(node, f"a call of {_short(called.id)} is not allowed")

    def look_at_Constant(self, node: ast.Constant, parent: ast.AST | None) -> None:
        if type(node.value) not in CONSTANTS:
            raise Refused(node, f"a constant of type {type(node.value).__name__} is not allowed")
        if isinstance(node.value, str):
            if (odd := NOT_IN_TEXT.search(node.value)) is not None:
                raise Refused(node, f"the program contains a control character ({odd[0]!r})")
        elif isinstance(node.value, (int, float)):
            check_number(node, node.value)

    def look_at_Dict(self, node: ast.Dict, parent: ast.AST | None) -> None:
        if not all(isinstance(key, ast.Constant) and isinstance(key.value, str) for key in node.keys):
            raise Refused(node, "the keys of a dict must be text")

    def look_at_UnaryOp(self, node: ast.UnaryOp, parent: ast.AST | None) -> None:
        number(node)

    def look_at_BinOp(self, node: ast.BinOp, parent: ast.AST | None) -> None:
        number(node)

    def offer(self) -> str:
        return ", ".join(f"self.{name}" for name in sorted(self.methods))


def number(node: ast.AST) -> int | float:
    """Evaluate arithmetic on numbers only. Text or lists times a number could fill the memory.

    Raises:
        Refused: an operand is not a number, or a result is out of bounds.
    """
    found: int | float
    if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)) and not isinstance(node.value, bool):
        found = node.value
    elif _is_name(node, "pi"):
        found = math.pi
    elif isinstance(node, (ast.UnaryOp, ast.BinOp)):
        found = _computed(node)
    else:
        raise Refused(node, "arithmetic is allowed with numbers only")
    check_number(node, found)
    return found


def _computed(node: ast.UnaryOp | ast.BinOp) -> int | float:
    parts = (node.operand,) if isinstance(node, ast.UnaryOp) else (node.left, node.right)
    values = [number(part) for part in parts]
    compute = OPERATORS.get(type(node.op))
    if compute is None:
        raise Refused(node, f"the operator {type(node.op).__name__} is not allowed")
    try:
        return compute(*values)
    except ZeroDivisionError as error:
        raise Refused(node, "division by zero is not allowed") from error
    except OverflowError as error:
        raise Refused(node, NOT_FINITE) from error


def check_number(node: ast.AST, number: int | float) -> None:
    """Refuse a number that JSON cannot store or that is too large for any task."""
    if isinstance(number, float):
        if not math.isfinite(number):
            raise Refused(node, NOT_FINITE)
    elif not -LARGEST <= number < LARGEST:
        raise Refused(node, TOO_MANY_BITS)


def is_super_init(node: ast.Attribute, parent: ast.AST | None) -> bool:
    """Return whether a node is the attribute in ``super().__init__()``."""
    called = node.value
    is_super = isinstance(called, ast.Call) and _is_name(called.func, "super")
    return node.attr == "__init__" and is_super and isinstance(parent, ast.Call) and parent.func is node


def _is_name(node: ast.AST, name: str) -> bool:
    return isinstance(node, ast.Name) and node.id == name


def _spoken(node: ast.AST) -> str:
    if type(node) in SPOKEN:
        return SPOKEN[type(node)]
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", type(node).__name__).lower()
    return f"{'an' if words[0] in 'aeiou' else 'a'} {words}"


def _short(name: str) -> str:
    return repr(name) if len(name) <= 60 else f"{name[:60]!r}..."

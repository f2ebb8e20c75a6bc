"""Write those tables of docs/ that are generated from the code; with ``--check`` only compare them.

Fields of ``task.yaml`` and types of criteria come from the classes that read them, solver options from their types.
With ``--check`` the exit code is 1 if a table differs.
"""

from __future__ import annotations

import argparse
import ast
import difflib
import inspect
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, BeforeValidator
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from gensim2.tasks.criteria import Criterion
from gensim2.tasks.spec import Made, ObjectSpec, Place, Provenance, Randomization, Step, TaskSpec, Verified

ROOT = Path(__file__).parents[1]

#: Where each class stands in a task file.
SECTIONS: dict[str, type[BaseModel]] = {
    "Top level": TaskSpec,
    "`objects.<name>`": ObjectSpec,
    "`objects.<name>.place`": Place,
    "`objects.<name>.randomization`": Randomization,
    "`steps[]`": Step,
    "`provenance`": Provenance,
    "`provenance.strategies.<name>`": Made,
    "`provenance.verification`": Verified,
}
#: Meanings of fields that no docstring has.
FIXED = {"schema_version": "version of the file format"}
#: A range of offsets has a validator of its own, which also takes one number.
OFFSET = "number from 0 to 1, or list of two from -1 to 1"


def fields_of_tasks() -> str:
    """Return the tables of every field of ``task.yaml``."""
    tables = []
    for title, model in SECTIONS.items():
        described = FIXED | attributes(model)
        rows = [
            (f"`{field.alias or name}`", kind(field), default(field), described[name])
            for name, field in model.model_fields.items()
        ]
        tables.append(f"### {title}\n\n{table(('field', 'type', 'default', 'meaning'), rows)}")
    return "\n\n".join(tables)


def criteria() -> str:
    """Return the table of every type of criterion."""
    rows = []
    for model in get_args(get_args(Criterion)[0]):
        fields = [
            f"`{name}`" + ("" if field.is_required() else f" ({default(field)})")
            for name, field in model.model_fields.items()
            if name != "type"
        ]
        rows.append(
            (f"`{model.model_fields['type'].default}`", sentence(inspect.getdoc(model) or ""), ", ".join(fields))
        )
    return table(("type", "the criterion is true if", "fields (default)"), rows)


def solver_options() -> str:
    """Return the tables of the solver's options, from the types that name them."""
    tree = ast.parse((ROOT / "python/gensim2_kpam/options.py").read_text(encoding="utf-8"))
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef)]
    tables = []
    for node in classes:
        rows = [
            (f"`{entry.target.id}`", sentence(ast.literal_eval(said.value)))
            for entry, said in zip(node.body, node.body[1:], strict=False)
            if isinstance(entry, ast.AnnAssign) and isinstance(entry.target, ast.Name) and isinstance(said, ast.Expr)
        ]
        tables.append(f"`{node.name}`:\n\n{table(('option', 'meaning (default)'), rows)}")
    return "\n\n".join(tables)


#: Marked blocks, by page and name.
BLOCKS: dict[tuple[str, str], Callable[[], str]] = {
    ("docs/reference/tasks.md", "fields"): fields_of_tasks,
    ("docs/reference/tasks.md", "criteria"): criteria,
    ("docs/reference/solver.md", "options"): solver_options,
}


def table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    """Return a table in Markdown."""
    lines = [head, ("---",) * len(head), *(tuple(cell.replace("|", "\\|") for cell in row) for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def attributes(model: type[BaseModel]) -> dict[str, str]:
    """Return the descriptions in a docstring's ``Attributes`` section, by name; empty without this section."""
    text = inspect.getdoc(model) or ""
    _, _, listed = text.partition("Attributes:\n")
    found: dict[str, str] = {}
    for entry in re.split(r"\n(?=    \w)", listed):
        names, _, said = entry.strip().partition(":")
        for name in names.split(", ") if re.fullmatch(r"[\w, ]+", names) else ():
            found[name] = sentence(said)
    return found


def sentence(text: str) -> str:
    """Convert text of a docstring to one line of Markdown."""
    plain = re.sub(r":\w+:`~?([^`]+)`", lambda found: f"``{found[1].rsplit('.', 1)[-1]}``", " ".join(text.split()))
    return re.sub(r"\bNone\b", "null", plain).replace("``", "`").rstrip(".")


def kind(field: FieldInfo) -> str:
    """Return the type of a field as text."""
    if any(isinstance(entry, BeforeValidator) for entry in field.metadata):
        return OFFSET
    bounds = [f"{sign} {number(value)}" for sign, value in _bounds(field.metadata)]
    return ", ".join([" or ".join(dict.fromkeys(_words(field.annotation))), *bounds])


def _bounds(metadata: list[Any]) -> Iterator[tuple[str, Any]]:
    for entry in metadata:
        for attribute, sign in (("gt", "over"), ("ge", "from"), ("lt", "below"), ("le", "to")):
            if getattr(entry, attribute, None) is not None:
                yield sign, getattr(entry, attribute)
        for attribute, words in (("min_length", "at least"), ("max_length", "at most")):
            if getattr(entry, attribute, None) is not None:
                yield words, getattr(entry, attribute)


def number(value: object) -> str:
    """Format a number for readers."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def _words(annotation: Any) -> Iterator[str]:
    origin = get_origin(annotation)
    if origin is Annotated:
        yield from _words(get_args(annotation)[0])
    elif origin in (Union, UnionType):
        for part in get_args(annotation):
            yield from _words(part)
    elif origin is Literal:
        yield from (f"`{value}`" for value in get_args(annotation))
    elif origin is tuple:
        parts = get_args(annotation)
        inner = " or ".join(dict.fromkeys(_words(parts[0])))
        yield f"list of {inner}" if parts[-1] is Ellipsis else f"{len(parts)} of {inner}"
    elif origin is dict:
        yield f"mapping from names to {' or '.join(dict.fromkeys(_words(get_args(annotation)[1])))}"
    elif annotation is NoneType:
        return
    elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield "criterion" if "type" in annotation.model_fields else "fields below"
    else:
        yield {"str": "text", "float": "number", "int": "whole number"}[annotation.__name__]


def default(field: FieldInfo) -> str:
    """Return a field's default as text."""
    if field.is_required() or field.default is PydanticUndefined:
        return "required"
    value = field.default
    if value is None:
        return "none"
    if isinstance(value, BaseModel):
        return "its defaults"
    if value in ((), {}):
        return "empty"
    if isinstance(value, tuple):
        return f"`[{', '.join(map(number, value))}]`"
    return f"`{number(value)}`"


def filled(text: str, name: str, body: str) -> str:
    """Replace a marked block of a page, and return the page.

    Raises:
        ValueError: the page has no such block.
    """
    begin, end = f"<!-- from code: {name} -->", "<!-- /from code -->"
    before, found, rest = text.partition(begin)
    _, closed, after = rest.partition(end)
    if not found or not closed:
        raise ValueError(f"no block {begin} ... {end}")
    return f"{before}{begin}\n\n{body}\n\n{end}{after}"


def pages() -> dict[Path, str]:
    """Return the text that each page should have."""
    made: dict[Path, str] = {}
    for (page, name), body in BLOCKS.items():
        path = ROOT / page
        made[path] = filled(made.get(path) or path.read_text(encoding="utf-8"), name, body())
    return made


def main() -> int:
    """Write or check the pages."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing; end with 1 where a page differs")
    check = parser.parse_args().check
    wrong = 0
    for path, text in pages().items():
        there = path.read_text(encoding="utf-8")
        if there == text:
            continue
        wrong += 1
        if check:
            name = str(path.relative_to(ROOT))
            sys.stdout.writelines(
                difflib.unified_diff(there.splitlines(True), text.splitlines(True), name, "from code")
            )
        else:
            path.write_text(text, encoding="utf-8")
    if check and wrong:
        print("run scripts/reference.py")
    return 1 if check and wrong else 0


if __name__ == "__main__":
    sys.exit(main())

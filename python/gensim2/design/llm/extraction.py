"""Plain data out of what a model wrote: fences, prose around, wrong quotes and trailing commas do no harm.

Nothing is evaluated. What comes out is what JSON can hold, and still has to be validated.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from gensim2.core.errors import InputError, MissingExtraError
from gensim2.core.yaml_files import check_finite, parse_yaml
from gensim2.design.llm.boundary import whole_characters

#: Characters of the longest text that data is looked for in; no answer of a stage needs a tenth of it.
MAX_CHARACTERS = 100_000

#: Most pieces of an answer that are read.
MAX_PIECES = 40

#: Values inside each other, more than any answer needs.
MAX_DEPTH = 20

#: Brackets inside each other beyond which a text is not repaired: the time goes with the square.
MAX_BRACKETS = 200

#: Name that a list gets which stands by itself.
ITEMS = "items"

Data = dict[str, Any]

_FENCE = re.compile(r"^[ \t]*(?:```|~~~)[^\n]*\n(.*?)(?:^[ \t]*(?:```|~~~)[ \t]*$|\Z)", re.DOTALL | re.MULTILINE)
_DOCUMENTS = re.compile(r"^---[ \t]*$|^\.\.\.[ \t]*$", re.MULTILINE)
_STRAIGHT = str.maketrans("“”‘’", "\"\"''")
_FIELD = re.compile(r"^(?:- )?[A-Za-z_][\w-]*:(?:[ \t]|$)", re.MULTILINE)


def mappings(text: str) -> list[Data]:
    """All maps that an answer holds, in order; a list that stands by itself is one with the field ``items``.

    Raises:
        InputError: the text is too long, or holds none; in words for the model.
    """
    if len(text) > MAX_CHARACTERS:
        raise InputError(f"the answer is longer than {MAX_CHARACTERS} characters")
    if '"' not in text:
        text = text.translate(_STRAIGHT)
    found: list[Data] = []
    trouble: list[str] = []
    for piece in _pieces(text):
        if len(found) == MAX_PIECES:
            break
        try:
            found.append(_read(piece))
        except InputError as error:
            trouble.append(error.message)
    if not found:
        raise InputError(trouble[0] if trouble else "the answer holds no JSON or YAML")
    return found


def _pieces(text: str) -> Iterator[str]:
    """Parts of a text that may be data: what is fenced; else what stands in braces; else lines with fields."""
    fenced = [match.group(1) for match in _FENCE.finditer(text)]
    if fenced:
        for block in fenced:
            yield from _documents(block)
        return
    stripped = text.strip()
    if stripped.startswith(("{", "[")):
        yield stripped
        return
    braced = list(_braced(text))
    if braced and not _FIELD.search(text):
        yield from braced
        return
    yield from _documents(_from_first_field(text))
    yield from braced


def _documents(block: str) -> Iterator[str]:
    for part in _DOCUMENTS.split(block):
        if part.strip():
            yield part


def _from_first_field(text: str) -> str:
    """Without the prose before the first line that looks like a field, and after the last indented or such line."""
    lines = text.splitlines()
    likely = [i for i, line in enumerate(lines) if _FIELD.match(line) or line.startswith(("  ", "- ", "---"))]
    return "\n".join(lines[likely[0] : likely[-1] + 1]) if likely else ""


def _braced(text: str) -> Iterator[str]:
    """Outermost ``{...}`` regions; the last may lack its end."""
    depth, start, quoted, escaped = 0, 0, "", False
    for index, character in enumerate(text):
        if quoted:
            if escaped:
                escaped = False
            elif character == "\\":
                escaped = True
            elif character == quoted or character == "\n":
                quoted = ""
        elif depth and character == '"':
            quoted = character
        elif character == "{":
            start = index if depth == 0 else start
            depth += 1
        elif character == "}" and depth:
            depth -= 1
            if depth == 0:
                yield text[start : index + 1]
    if depth:
        yield text[start:]


def _read(piece: str) -> Data:
    """One map. Strictly, as YAML, of which JSON is a part; else with json-repair, where it looks like JSON."""
    stripped = piece.strip("\n")
    looks_like_json = stripped.lstrip().startswith(("{", "["))
    listed = stripped.lstrip().startswith(("- ", "["))
    try:
        return parse_yaml((f"{ITEMS}:\n{stripped}" if listed else stripped).encode("utf-8", "replace"), "answer")
    except InputError as error:
        if not looks_like_json:
            where = f"{error.field}: " if error.field else ""
            raise InputError(f"the answer {where}{error.message}") from error
    if _brackets(stripped) > MAX_BRACKETS:
        raise InputError("the answer has too many values inside each other")
    try:
        import json_repair
    except ImportError as error:
        raise MissingExtraError("json_repair", "llm") from error
    try:
        value = json_repair.loads(stripped)
    except (ValueError, RecursionError, IndexError, TypeError) as error:
        raise InputError("the answer is no valid JSON") from error
    if isinstance(value, list):
        value = {ITEMS: value}
    if not isinstance(value, dict) or not value:
        raise InputError("the answer is no valid JSON")
    _check_depth(value)
    check_finite(value, None)
    _check_characters(value)
    return value


def _brackets(text: str) -> int:
    """Most brackets that are open at once."""
    depth = most = 0
    for character in text:
        depth += (character in "{[") - (character in "}]")
        most = max(most, depth)
    return most


def _check_depth(value: Any, depth: int = 0) -> None:
    if depth > MAX_DEPTH:
        raise InputError("the answer has too many values inside each other")
    for inner in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        _check_depth(inner, depth + 1)


def _check_characters(value: Any) -> None:
    """Refuse half characters, which escapes in JSON can make; :func:`parse_yaml` does the same."""
    if isinstance(value, str) and whole_characters(value) != value:
        raise InputError("the answer holds half a character (a lone surrogate)")
    if isinstance(value, dict):
        for inner in (*value, *value.values()):
            _check_characters(inner)
    elif isinstance(value, list):
        for inner in value:
            _check_characters(inner)

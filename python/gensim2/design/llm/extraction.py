"""Extract data from a model's answer, despite code fences, surrounding prose, wrong quotes and trailing commas.

Nothing in the answer is executed. The caller must validate the extracted data.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from gensim2.core.errors import InputError, required
from gensim2.core.yaml_files import check_finite, parse_yaml
from gensim2.design.llm.boundary import whole_characters

#: Maximum number of characters of an answer; valid answers are ten times shorter.
MAX_CHARACTERS = 100_000

#: Maximum number of data blocks read from an answer.
MAX_PIECES = 40

#: Maximum nesting of the data.
MAX_DEPTH = 20

#: Maximum nesting depth of brackets in a text to repair. The time of the repair grows with the square of the depth.
MAX_BRACKETS = 200

#: Field name for a top-level list.
ITEMS = "items"

Data = dict[str, Any]

_FENCE = re.compile(r"^[ \t]*(?:```|~~~)[^\n]*\n(.*?)(?:^[ \t]*(?:```|~~~)[ \t]*$|\Z)", re.DOTALL | re.MULTILINE)
_DOCUMENTS = re.compile(r"^---[ \t]*$|^\.\.\.[ \t]*$", re.MULTILINE)
_STRAIGHT = str.maketrans("“”‘’", "\"\"''")
_FIELD = re.compile(r"^(?:- )?[A-Za-z_][\w-]*:(?:[ \t]|$)", re.MULTILINE)


def mappings(text: str) -> list[Data]:
    """Return all mappings (objects) in an answer, in order; a top-level list becomes ``{"items": [...]}``.

    Raises:
        InputError: the text is too long or holds no data; the message is written for the model.
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
    """Yield the code blocks of a text, or else passages in braces and lines like ``key: value``."""
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
    """Return the text from the first to the last line that looks like a field."""
    lines = text.splitlines()
    likely = [i for i, line in enumerate(lines) if _FIELD.match(line) or line.startswith(("  ", "- ", "---"))]
    return "\n".join(lines[likely[0] : likely[-1] + 1]) if likely else ""


def _braced(text: str) -> Iterator[str]:
    """Yield the outermost ``{...}`` regions of a text; the last region may lack its closing brace."""
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
    """Parse one mapping as YAML (which includes JSON); repair text that resembles JSON with json-repair."""
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
        raise InputError("the values in the answer are nested too deeply")
    try:
        value = required("json_repair", "llm").loads(stripped)
    except (ValueError, RecursionError, IndexError, TypeError) as error:
        raise InputError("the answer is not valid JSON") from error
    if isinstance(value, list):
        value = {ITEMS: value}
    if not isinstance(value, dict) or not value:
        raise InputError("the answer is not valid JSON")
    _check_depth(value)
    check_finite(value, None)
    _check_characters(value)
    return value


def _brackets(text: str) -> int:
    depth = most = 0
    for character in text:
        depth += (character in "{[") - (character in "}]")
        most = max(most, depth)
    return most


def _check_depth(value: Any, depth: int = 0) -> None:
    if depth > MAX_DEPTH:
        raise InputError("the values in the answer are nested too deeply")
    for inner in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        _check_depth(inner, depth + 1)


def _check_characters(value: Any) -> None:
    """Refuse lone surrogates, which JSON escapes can create; :func:`parse_yaml` refuses them, too."""
    if isinstance(value, str) and whole_characters(value) != value:
        raise InputError("the answer contains an unpaired surrogate, which is not a valid Unicode character")
    if isinstance(value, dict):
        for inner in (*value, *value.values()):
            _check_characters(inner)
    elif isinstance(value, list):
        for inner in value:
            _check_characters(inner)

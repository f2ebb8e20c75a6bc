"""Read and write YAML files of plain data, with limits on size, depth and repetition.

Files may be untrusted or come from language models. A file may contain mappings with text keys, lists, text, numbers,
true, false and null. Dates, merge keys (``<<``), custom tags and cyclic anchors are not allowed.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import yaml
from yaml.composer import Composer
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from gensim2.core.errors import InputError
from gensim2.core.special_files import is_special

#: Maximum size of a file, bytes; gensim2's own files have about 2 kB.
MAX_BYTES = 100_000
#: Maximum nesting of lists and mappings; gensim2's own files have 4 levels.
MAX_DEPTH = 30
#: Maximum number of values. A value that is repeated by an alias is counted again for each alias.
MAX_VALUES = 20_000

#: Maximum length of an invalid integer that a message quotes. Python refuses to convert very long integers.
LONGEST_WHOLE_NUMBER = 100
TOO_MANY_BITS = "a whole number of more than 64 bits"

_PLAIN = ("map", "seq", "str", "int", "float", "bool", "null")
_PREFIX = "tag:yaml.org,2002:"


def read_yaml(path: Path) -> dict[str, Any]:
    """Read a YAML or JSON file.

    Raises:
        InputError: the file cannot be read, is not a regular file, or is refused by :func:`parse_yaml`.
    """
    try:
        if is_special(path):
            raise InputError("is not a regular file", file=path)
        with path.open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except OSError as error:
        remedy = "give an existing file" if isinstance(error, FileNotFoundError) else None
        raise InputError(f"cannot read: {error.strerror}", file=path, remedy=remedy) from error
    return parse_yaml(data, str(path))


def dump_yaml(value: dict[str, Any]) -> str:
    """Return a value as YAML text; mappings keep their order, and lists of numbers stay on one line."""
    return str(yaml.dump(value, sort_keys=False, default_flow_style=None, width=100, allow_unicode=True))


def parse_yaml(data: bytes, file: str) -> dict[str, Any]:
    """Parse YAML text. Numbers must be finite, and integers must fit into 64 bits.

    Raises:
        InputError: the file is not UTF-8 or not YAML, is too large or nested too deeply, or cannot be expressed in
            JSON. The message gives the line.
    """
    if len(data) > MAX_BYTES:
        raise InputError(f"is larger than {MAX_BYTES // 1000} kB", file=file)
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError("is not UTF-8 text", file=file) from error
    try:
        value = yaml.load(text, Loader=_PlainLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"line {mark.line + 1}" if mark else None
        problem = ", ".join(part for part in (error.context, error.problem) if part)
        raise InputError(f"is not valid YAML: {problem}", file=file, field=where) from error
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        wrong = "is not valid YAML: the line contains a control character"
        raise InputError(wrong, file=file, field=f"line {line}") from error
    if not isinstance(value, dict):
        raise InputError("the text must be a mapping from field names to values", file=file, field="line 1")
    check_finite(value, file)
    return value


def check_finite(value: Any, file: str | None, field: str = "") -> None:
    """Refuse NaN and infinity anywhere in plain data.

    Raises:
        InputError: a number is NaN or infinite; the message names its field.
    """
    if isinstance(value, float) and not math.isfinite(value):
        raise InputError(f"must be a finite number, but is {value}", file=file, field=field)
    if isinstance(value, dict):
        for key, item in value.items():
            check_finite(item, file, f"{field}.{key}" if field else str(key))
    elif isinstance(value, list | tuple):
        for index, item in enumerate(value):
            check_finite(item, file, f"{field}.{index}" if field else str(index))


class _FastLoader(Composer, getattr(yaml, "CSafeLoader", object)):  # type: ignore[misc]
    """Loader with libyaml's parser and PyYAML's composer.

    The parser is 5 times as fast as PyYAML's, and the composer can enforce limits.
    """

    def __init__(self, stream: str) -> None:
        yaml.CSafeLoader.__init__(self, stream)
        Composer.__init__(self)


# PyYAML's wheels include libyaml; a build from source may not.
_Loader: Any = _FastLoader if hasattr(yaml, "CSafeLoader") else yaml.SafeLoader


class _PlainLoader(_Loader):  # type: ignore[misc]
    """Loader that limits size and depth and constructs only JSON types."""

    def __init__(self, stream: str) -> None:
        super().__init__(stream)
        self._depth = 0
        self._values = 0
        self._repeats: dict[Node, int] = {}

    def compose_node(self, parent: Node | None, index: int) -> Node | None:
        event = self.peek_event()
        if isinstance(event, yaml.AliasEvent):
            node: Node | None = super().compose_node(parent, index)
            assert node is not None
            if node not in self._repeats:
                raise _refusal(f"*{event.anchor} refers to itself", event.start_mark)
            self._count(self._repeats[node], event.start_mark)
            return node
        if self._depth == MAX_DEPTH:
            raise _refusal(f"is nested more than {MAX_DEPTH} levels deep", event.start_mark)
        before = self._values
        self._depth += 1
        node = super().compose_node(parent, index)
        self._depth -= 1
        self._count(1, event.start_mark)
        if node is not None and getattr(event, "anchor", None) is not None:
            self._repeats[node] = self._values - before
        return node

    def _count(self, values: int, mark: Any) -> None:
        self._values += values
        if self._values > MAX_VALUES:
            raise _refusal(f"more than {MAX_VALUES} values, repeated ones included", mark)

    def construct_object(self, node: Node, deep: bool = False) -> Any:
        name = node.tag.removeprefix(_PREFIX)
        if name not in _PLAIN:
            name = "date" if name == "timestamp" else name.strip("!")
            raise _refusal(f"a value of type {name} is not allowed (put text in quotes)", node.start_mark)
        try:
            value = super().construct_object(node, deep=deep)
        except (ValueError, LookupError, TypeError, AttributeError) as error:
            if name == "int" and len(node.value) > LONGEST_WHOLE_NUMBER:
                raise _refusal(TOO_MANY_BITS, node.start_mark) from error
            raise _refusal(f"{_shown(node)} is not a valid {name}", node.start_mark) from error
        if isinstance(value, int) and not -(2**63) <= value < 2**63:
            raise _refusal(TOO_MANY_BITS, node.start_mark)
        if isinstance(value, str) and not value.isascii() and any("\ud800" <= c <= "\udfff" for c in value):
            raise _refusal("contains an unpaired UTF-16 surrogate, which is not a valid character", node.start_mark)
        return value

    def construct_mapping(self, node: MappingNode, deep: bool = False) -> dict[Any, Any]:
        if not isinstance(node, MappingNode):
            raise _refusal(f"{_shown(node)} is not a mapping", node.start_mark)
        found: dict[str, Any] = {}
        for key_node, value_node in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, str):
                raise _refusal(f"the name of a field must be text, but is {_shown(key_node)}", key_node.start_mark)
            if key in found:  # PyYAML would silently keep the last value of a repeated key
                raise _refusal(f"field {key!r} is given twice", key_node.start_mark)
            found[key] = self.construct_object(value_node, deep=deep)
        return found


# Only true and false are booleans. In YAML 1.1, "on", "off", "yes" and "no" are booleans too, but "on" is a field here.
_BOOL = _PREFIX + "bool"
_PlainLoader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag != _BOOL]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_PlainLoader.add_implicit_resolver(_BOOL, re.compile("^(?:true|True|TRUE|false|False|FALSE)$"), list("tTfF"))


def _shown(node: Node) -> str:
    if isinstance(node, ScalarNode):
        return f"{node.value!r}"
    return "a list" if isinstance(node, SequenceNode) else "a mapping"


def _refusal(problem: str, mark: Any) -> yaml.constructor.ConstructorError:
    return yaml.constructor.ConstructorError(None, None, problem, mark)

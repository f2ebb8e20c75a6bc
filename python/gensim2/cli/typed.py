"""Generate command-line options from typed functions and classes.

A parameter's type and default define its option, and the docstring's ``Args`` (``Attributes`` for a class) contain its
help text.
"""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import click

_SECTION = re.compile(r"\n+(?:Args|Attributes|Returns|Raises|Example):\n")
_ENTRY = re.compile(r"^    (\w+): ", re.M)


@dataclass(frozen=True)
class Option:
    """Details of an option beyond its type, given in ``Annotated``.

    Attributes:
        flags: names on the command line, separated by spaces. If it is empty, the option has the parameter's name.
        metavar: placeholder of the value in the help.
        shown: text that the help shows instead of the default value.
    """

    flags: str = ""
    metavar: str | None = None
    shown: str | None = None


class Real(click.FloatRange):
    """Parameter type for a number in a range. Click itself would accept NaN for every range; this type refuses NaN."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number."""
        number = super().convert(value, param, ctx)
        if math.isnan(number):
            self.fail(f"{value} is not a number.", param, ctx)
        return number


def count(max_count: int = 1_000_000) -> click.IntRange:
    """Return the parameter type of whole numbers from 1 to ``max_count``. The maximum limits the run time."""
    return click.IntRange(1, max_count)


Count = Annotated[int, count()]
Folder = Annotated[Path, Option(metavar="DIR")]
File = Annotated[Path, Option(metavar="FILE")]
Name = Annotated[str, Option(metavar="NAME")]
Tasks = Annotated[tuple[str, ...], Option("--task", "NAME")]


def summary(source: Any) -> str:
    """Return the text of a docstring that precedes its sections (``Args``, ``Raises`` and so on)."""
    return _SECTION.split(inspect.getdoc(source) or "")[0]


def options_of_class(source: type) -> dict[str, click.Parameter]:
    """Return an option for each annotated attribute of a class, by name."""
    hints, texts = get_type_hints(source, include_extras=True), _texts(source)
    return {name: _option(name, hint, getattr(source, name, ...), texts[name]) for name, hint in hints.items()}


def parameters(function: Callable[..., Any], shared: Mapping[str, click.Parameter]) -> list[click.Parameter]:
    """Return the command-line parameters of a function. Positional parameters become arguments, and keyword-only
    parameters become options.

    Args:
        function: the command's function; its parameter ``progress`` is not a command-line parameter.
        shared: shared options by name. A keyword-only parameter that the docstring does not describe becomes the shared
            option with the same name. If the parameter has a default, the option gets this default instead of its usual
            default.
    """
    hints, texts = get_type_hints(function, include_extras=True), _texts(function)
    found: list[click.Parameter] = []
    for each in inspect.signature(function).parameters.values():
        default = ... if each.default is each.empty else each.default
        if each.kind is each.POSITIONAL_OR_KEYWORD:
            found.append(_argument(each.name, hints[each.name], default))
        elif each.kind is each.KEYWORD_ONLY and each.name in texts:
            found.append(_option(each.name, hints[each.name], default, texts[each.name]))
        elif each.kind is each.KEYWORD_ONLY and each.name != "progress":
            found.append(shared[each.name] if default is ... else _with_default(shared[each.name], default))
    return found


def _with_default(option: click.Parameter, default: Any) -> click.Option:
    assert isinstance(option, click.Option)
    return click.Option(
        [option.name or "", *option.opts, *option.secondary_opts],
        type=option.type,
        metavar=option.metavar,
        help=option.help,
        default=default,
        show_default=default is not None,
    )


def _texts(source: Any) -> dict[str, str]:
    """Return the descriptions of parameters or attributes, by name."""
    _, *sections = _SECTION.split(inspect.getdoc(source) or "")
    parts = _ENTRY.split("\n".join(sections))
    return {name: " ".join(text.split()) for name, text in zip(parts[1::2], parts[2::2], strict=True)}


def _argument(name: str, hint: Any, default: Any) -> click.Argument:
    kind, details, several = _kind(hint)
    return click.Argument(
        [name],
        type=kind,
        nargs=-1 if several else 1,
        required=default is ...,
        metavar=details.metavar,
        **({} if several or default is ... else {"default": default}),
    )


def _option(name: str, hint: Any, default: Any, text: str) -> click.Option:
    kind, details, several = _kind(hint)
    word = name.strip("_").replace("_", "-")
    switch = kind is click.BOOL
    usual = f"--{word}/--no-{word}" if switch and default is not False else f"--{word}"
    return click.Option(
        [name, *(details.flags or usual).split()],
        type=kind,
        multiple=several,
        required=default is ...,
        show_default=details.shown or not (several or any(default is each for each in (None, False, ...))),
        is_flag=switch or None,
        metavar=details.metavar,
        help=text,
        **({} if several or default is ... else {"default": default}),
    )


def _kind(hint: Any) -> tuple[click.ParamType[Any], Option, bool]:
    """Return click's type for an annotated parameter, its ``Option``, and whether the option accepts several values."""
    kind: click.ParamType[Any] | None = None
    details, several = Option(), False
    while (origin := get_origin(hint)) in (Annotated, Union, UnionType, tuple):
        inner, *beside = get_args(hint)
        if origin is Annotated:
            for each in beside:
                if isinstance(each, Option):
                    details = details if details.flags or details.metavar or details.shown else each
                else:
                    kind = kind or each
        elif origin is tuple:
            several = True
        else:
            (inner,) = (each for each in get_args(hint) if each is not NoneType)
        hint = inner
    if kind is None:
        if origin is Literal:
            kind = click.Choice(get_args(hint))
        else:
            kind = click.Path(path_type=Path) if hint is Path else click.types.convert_type(hint)
    return kind, details, several

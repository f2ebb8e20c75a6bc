"""Define settings as frozen dataclasses whose fields have help texts and allowed ranges."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any, ClassVar, Self

from gensim2.core.errors import InputError, near


def setting(
    default: Any,
    text: str,
    *,
    choices: Sequence[str] = (),
    low: float | None = None,
    high: float | None = None,
) -> Any:
    """Return a dataclass field with its help text and its allowed values.

    Args:
        default: default value and so type of the field; None allows an integer or None.
        text: help text of the field and of its command-line option.
        choices: allowed strings.
        low, high: inclusive bounds of a number.
    """
    return field(default=default, metadata={"help": text, "choices": tuple(choices), "low": low, "high": high})


@dataclass(frozen=True)
class Settings:
    """Base class of settings; the fields are defined with :func:`setting`.

    Raises:
        InputError: a value has the wrong type or is out of range; the message names the field.
    """

    of_what: ClassVar[str] = "settings"

    def __post_init__(self) -> None:
        for each in fields(self):
            object.__setattr__(
                self, each.name, _checked(getattr(self, each.name), each.default, each.metadata, each.name)
            )

    @classmethod
    def of(cls, values: Mapping[str, Any], *, file: str | None = None) -> Self:
        """Return settings from plain data.

        Raises:
            InputError: a field is unknown or invalid; the message names ``file`` and the field.
        """
        known = {each.name for each in fields(cls)}
        for name in values:
            if name not in known:
                remedy = near(name, sorted(known))
                raise InputError(f"is not a field of the {cls.of_what}", file=file, field=str(name), remedy=remedy)
        try:
            return cls(**values)
        except InputError as error:
            raise InputError(error.message, file=file, field=error.field, remedy=error.remedy) from error

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)


def _checked(value: Any, default: Any, metadata: Mapping[str, Any], name: str) -> Any:
    if default is None:
        if value is None:
            return None
        default = 0
    kind = type(default)
    if kind is float and type(value) is int and abs(value) <= sys.float_info.max:
        value = float(value)
    if type(value) is not kind:
        words = {int: "a whole number", float: "a number", bool: "true or false", str: "text"}
        raise InputError(f"must be {words[kind]}, but is {value!r}", field=name)
    if metadata["choices"] and value not in metadata["choices"]:
        raise InputError(f"must be one of {', '.join(metadata['choices'])}, but is {value!r}", field=name)
    low, high = metadata["low"], metadata["high"]
    if (low is not None and not value >= low) or (high is not None and not value <= high):
        bounds = " and ".join(
            text for text in (low is not None and f"at least {low}", high is not None and f"at most {high}") if text
        )
        raise InputError(f"must be {bounds}, but is {value}", field=name)
    return value

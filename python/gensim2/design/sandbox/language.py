"""Define the functions and values of the task language, and the task fields that they produce.

A class derived from ``Task`` names objects (``self.drawer = Object("drawer")``), steps (``self.step``) and the goal
(``self.goal``). The types of criteria are functions. Values are checked when the fields are parsed.
"""

from __future__ import annotations

import math
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from gensim2.tasks.criteria import Criterion
from gensim2.tasks.spec import HAND

#: Methods that a program in the task language may call on ``self``.
METHODS = ("step", "goal")
#: Fields of the task that a program may set as attributes of ``self`` or of the class.
SETTINGS = ("description", "max_episode_steps")
#: Maximum number of values and of characters. Nested lists could otherwise repeat each other to an exponential size.
MAX_SIZE = 100_000
#: Maximum nesting of values.
MAX_DEPTH = 50


class Fields:
    """A value of the task language that consists of named fields. Omitted fields keep their defaults.

    Args:
        kind: name of the function that creates the value; error messages contain this name.
        names: names of the fields, in order.
        values: positional arguments.
        named: keyword arguments.

    Raises:
        TypeError: a field is unknown or given twice; the message lists the fields.
    """

    def __init__(self, kind: str, names: Sequence[str], values: Iterable[Any], named: Mapping[str, Any]) -> None:
        self.given = arguments(kind, names, values, named)


class Object(Fields):
    """Object of an asset class.

    The attribute of the task that has the object gives the object its name.
    """

    def __init__(self, *values: Any, **named: Any) -> None:
        super().__init__("Object", ("asset_class", "instances", "place", "randomization"), values, named)
        self.name: str | None = None


def _place(*values: Any, **named: Any) -> Fields:
    """Return a placement: support ``on`` ("table" or an object), position ``at`` (x, y) in m, and ``yaw`` in rad."""
    return Fields("Place", ("on", "at", "yaw"), values, named)


def _randomization(*values: Any, **named: Any) -> Fields:
    """Return ranges of the scene: ``x`` and ``y`` in m (a number or a pair), ``yaw`` in rad, openness from 0 to 1."""
    return Fields("Randomization", ("x", "y", "yaw", "openness_mean", "openness_spread"), values, named)


class Task:
    """The task that a program builds. In the program, ``self`` refers to this object.

    Args:
        members: attributes that the program defines in the body of its class.

    Attributes:
        own: attributes that the program assigned to ``self``.
    """

    def __init__(self, members: Mapping[str, Any] | None = None) -> None:
        self._members = {**dict.fromkeys(SETTINGS), **(members or {})}
        self.own: dict[str, Any] = {}
        self._steps: list[dict[str, Any]] = []
        self._goal: list[Any] | None = None

    def get(self, name: str) -> Any:
        """Return an attribute.

        Raises:
            AttributeError: there is no attribute of this name.
        """
        for known in (self.own, self._members, {"step": self.step, "goal": self.goal}):
            if name in known:
                return known[name]
        raise AttributeError(f"self has no attribute {name!r}")

    def set(self, name: str, value: Any) -> None:
        """Assign an attribute. If the value is an object, the attribute's name becomes the object's name.

        Raises:
            ValueError: the object already has another name, or the attribute is reserved for a setting.
        """
        if isinstance(value, Object):
            if name in SETTINGS:
                raise ValueError(f"an object cannot be named {name!r}, because the name is reserved for a setting")
            if value.name not in (None, name):
                raise ValueError(f"one object cannot be both {value.name!r} and {name!r}")
            value.name = name
        self.own[name] = value

    def step(
        self, name: str, object: Any, tool: Any = HAND, strategies: Sequence[str] | None = None, done: Any = ()
    ) -> None:
        """Add a step to the task. A step consists of an actuation pose and the motions to and from this pose.

        Args:
            name: name of the step, unique in the task.
            object: the object that the step acts on.
            tool: "hand", or the grasped object whose keypoints replace the hand's keypoints.
            strategies: names of alternative strategies. By default, there is one strategy with the name of the step.
            done: criteria of the step's success.
        """
        names = [name] if strategies is None else strategies
        step = {"name": name, "object": object, "tool": tool, "strategies": names, "done": listed(done)}
        self._steps.append(step)

    def goal(self, *criteria: Any) -> None:
        """Set the criteria that must all hold at the end; default: the last step's ``done``."""
        self._goal = self._goal or []
        for given in criteria:
            self._goal += listed(given)

    def fields(self, name: str, docstring: str | None) -> dict[str, Any]:
        """Return the task's fields in the form that :func:`gensim2.tasks.parse.parse_task` reads.

        Args:
            docstring: docstring of the class. It is the description unless there is an attribute ``description``.

        Raises:
            ValueError: a value cannot be converted to JSON data.
        """
        given = {**self._members, **self.own}
        objects = {key: value for key, value in self.own.items() if isinstance(value, Object)}
        fields: dict[str, Any] = {
            "schema_version": 2,
            "name": name,
            "description": given["description"] or (docstring or "").strip(),
            "objects": {key: _object(value) for key, value in objects.items()},
            "steps": self._steps,
        }
        if self._goal is not None:
            fields["goal"] = self._goal
        if given["max_episode_steps"] is not None:
            fields["max_episode_steps"] = given["max_episode_steps"]
        found: dict[str, Any] = _Plain().of(fields)
        return found


def listed(value: Any) -> list[Any]:
    """Return a list or tuple as a list, and any other value as a list with one element."""
    return list(value) if isinstance(value, (list, tuple)) else [value]


def arguments(function: str, names: Sequence[str], values: Iterable[Any], named: Mapping[str, Any]) -> dict[str, Any]:
    """Bind arguments to names as Python does, and drop arguments that are None.

    Raises:
        TypeError: an argument is unknown or given twice.
    """
    values = list(values)
    takes = f"{function}() takes {', '.join(names)}"
    if len(values) > len(names):
        raise TypeError(f"{takes}; {len(values)} arguments were given")
    found = dict(zip(names, values, strict=False))
    for name, value in named.items():
        if name not in names:
            raise TypeError(f"{takes}; not {name!r}")
        if name in found:
            raise TypeError(f"{takes}; {name!r} was given twice")
        found[name] = value
    return {name: value for name, value in found.items() if value is not None}


def _criterion(kind: str, names: tuple[str, ...]) -> Callable[..., dict[str, Any]]:
    """Return the function with which task code creates a success criterion of type ``kind``."""

    def make(*values: Any, **named: Any) -> dict[str, Any]:
        return {"type": kind, **arguments(kind, names, values, named)}

    return make


#: Functions that create criteria, by type.
CRITERIA = {
    model.model_fields["type"].default: _criterion(
        model.model_fields["type"].default, tuple(name for name in model.model_fields if name != "type")
    )
    for model in typing.get_args(typing.get_args(Criterion)[0])
}
#: Names that a program may import.
OFFERED: dict[str, Any] = {
    "Object": Object,
    "Place": _place,
    "Randomization": _randomization,
    "Task": Task,
    "pi": math.pi,
    **CRITERIA,
}


def _object(value: Object) -> dict[str, Any]:
    fields = dict(value.given)
    return {"class": fields.pop("asset_class", None), **fields}


class _Plain:
    """Converter of task values to JSON data of limited size.

    Objects become names, and ``Fields`` become dictionaries.
    """

    def __init__(self) -> None:
        self._size = 0

    def of(self, value: Any, depth: int = 0) -> Any:
        """Return ``value`` as JSON data.

        Raise ValueError if it is too large or deep, unnamed, or of an unknown type.
        """
        self._size += 1 + (len(value) if isinstance(value, str) else 0)
        if self._size > MAX_SIZE:
            raise ValueError(f"the task contains more than {MAX_SIZE} values and characters in total")
        if depth > MAX_DEPTH:
            raise ValueError("values are nested too deeply")
        if isinstance(value, Object):
            if value.name is None:
                wrong = "an object was used before it was assigned to an attribute; first write self.name = Object(...)"
                raise ValueError(wrong)
            return value.name
        if isinstance(value, Fields):
            return self.of(value.given, depth)
        if isinstance(value, dict):
            return {self.of(key, depth): self.of(inner, depth + 1) for key, inner in value.items()}
        if isinstance(value, (list, tuple)):
            return [self.of(inner, depth + 1) for inner in value]
        if value is None or isinstance(value, (str, int, float)):
            return value
        raise ValueError(f"a task cannot contain a value of type {type(value).__name__}")

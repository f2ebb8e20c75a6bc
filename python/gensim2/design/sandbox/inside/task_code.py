"""API for generated task classes: imported by that code, inside the sandbox, and needs Python only.

A class derived from :class:`Task` names its objects (``self.drawer = Object("drawer")``), its steps (``self.step``) and
what must hold at the end (``self.goal``). Criteria are functions called as the types of
:mod:`gensim2.tasks.criteria` are; :func:`add_criteria` makes them. Values are checked by whoever reads the result.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import pi
from typing import Any

__all__ = ["Object", "Place", "Randomization", "Task", "pi"]

HAND = "hand"
METHODS = ("step", "goal")


class Fields:
    """Fields that were given, by name; those that were not are left to their defaults.

    Raises:
        TypeError: a field is unknown or given twice; names those that there are.
    """

    names: tuple[str, ...] = ()

    def __init__(self, *values: Any, **named: Any) -> None:
        self.given = arguments(type(self).__name__, self.names, values, named)


class Place(Fields):
    """Placement of an object: ``on`` "table" or another object, ``at`` (x, y) in m, ``yaw`` in rad."""

    names = ("on", "at", "yaw")


class Randomization(Fields):
    """Ranges of the scene: ``x`` and ``y`` in m (a number or a pair), ``yaw`` in rad, openness from 0 to 1."""

    names = ("x", "y", "yaw", "openness_mean", "openness_spread")


class Object(Fields):
    """An object of a class of assets; it is called as the attribute of the task that it is given to."""

    names = ("asset_class", "instances", "place", "randomization")
    name: str | None = None


class Task:
    """A task; its ``description`` is what a person would ask for, one phrase in lower case."""

    description = ""
    max_episode_steps: int | None = None

    def __init__(self) -> None:
        """Do nothing: for those who are used to call it."""

    def __setattr__(self, name: str, value: Any) -> None:
        """An object takes the name of the attribute that it is given to."""
        if isinstance(value, Object):
            if value.name not in (None, name):
                raise ValueError(f"one object cannot be both {value.name!r} and {name!r}")
            value.name = name
        object.__setattr__(self, name, value)

    def step(
        self, name: str, object: Any, tool: Any = HAND, strategies: Sequence[str] | None = None, done: Any = ()
    ) -> None:
        """One actuation pose with its motions.

        Args:
            name: unique in the task.
            object: what it acts on.
            tool: "hand", or the object that is held and whose keypoints take the place of the hand's.
            strategies: names of ways to do it; default: one, called as the step is.
            done: criteria that must hold once in its turn.
        """
        ways = [name] if strategies is None else strategies
        step = {"name": name, "object": object, "tool": tool, "strategies": ways, "done": listed(done)}
        self.__dict__.setdefault("_steps", []).append(step)

    def goal(self, *criteria: Any) -> None:
        """Set the criteria that must all hold at the end; without a call, those of the last step's ``done``."""
        self.__dict__.setdefault("_goal", []).extend(one for given in criteria for one in listed(given))


def listed(value: Any) -> list[Any]:
    """A list of it, or the list that it is."""
    return list(value) if isinstance(value, (list, tuple)) else [value]


def arguments(function: str, names: Sequence[str], values: Iterable[Any], named: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments by name, as Python binds them; None are left out.

    Raises:
        TypeError: one is unknown or given twice.
    """
    values = list(values)
    takes = f"{function}() takes {', '.join(names)}"
    if len(values) > len(names):
        raise TypeError(f"{takes}; {len(values)} were given")
    found = dict(zip(names, values, strict=False))
    for name, value in named.items():
        if name not in names:
            raise TypeError(f"{takes}; not {name!r}")
        if name in found:
            raise TypeError(f"{takes}; {name!r} was given twice")
        found[name] = value
    return {name: value for name, value in found.items() if value is not None}


def add_criteria(namespace: dict[str, Any], types: Mapping[str, Sequence[str]]) -> None:
    """Put a function for each type of criterion into a namespace.

    Args:
        namespace: of this module.
        types: its arguments, in order, by type.
    """
    for kind, names in types.items():
        namespace[kind] = criterion(kind, tuple(names))
        namespace["__all__"].append(kind)


def criterion(kind: str, names: tuple[str, ...]) -> Callable[..., dict[str, Any]]:
    """The function that makes a criterion of one type."""

    def make(*values: Any, **named: Any) -> dict[str, Any]:
        return {"type": kind, **arguments(kind, names, values, named)}

    make.__name__ = kind
    return make


def fields_of(task: Task) -> dict[str, Any]:
    """A task's fields as :func:`gensim2.tasks.parse.parse_task` reads them."""
    members = vars(task)
    objects = {name: value for name, value in members.items() if isinstance(value, Object)}
    fields: dict[str, Any] = {
        "schema_version": 2,
        "name": type(task).__name__,
        "description": task.description or (type(task).__doc__ or "").strip(),
        "objects": {name: plain(_object(value)) for name, value in objects.items()},
        "steps": plain(members.get("_steps", [])),
    }
    if "_goal" in members:
        fields["goal"] = plain(members["_goal"])
    if task.max_episode_steps is not None:
        fields["max_episode_steps"] = task.max_episode_steps
    return fields


def _object(value: Object) -> dict[str, Any]:
    fields = dict(value.given)
    return {"class": fields.pop("asset_class", None), **fields}


def plain(value: Any) -> Any:
    """The same without objects of this module: an object is its name, a value with fields is its fields.

    Raises:
        ValueError: an object has no name.
    """
    if isinstance(value, Object):
        if value.name is None:
            raise ValueError("an object is used that was not given a name: self.name = Object(...)")
        return value.name
    if isinstance(value, Fields):
        return plain(value.given)
    if isinstance(value, dict):
        return {key: plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(inner) for inner in value]
    return value

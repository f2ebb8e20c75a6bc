"""Convert users' arguments ``task``, ``assets`` and ``instances`` to a task, a library and ids."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from gensim2.core.errors import InputError, near
from gensim2.objects import ArticulatedObject, RigidObject, open_library
from gensim2.objects.library.selection import taken_instances, words_of_objects
from gensim2.objects.types import Hulls
from gensim2.robots import RobotProfile
from gensim2.tasks.library import load_task
from gensim2.tasks.parse import parse_task
from gensim2.tasks.spec import TaskSpec


class ObjectSource(Protocol):
    """Interface of an object library from which environments load their objects."""

    def source(self, asset_class: str, /) -> str: ...
    def instances(self, asset_class: str, /) -> tuple[str, ...]: ...
    def load(self, asset_class: str, instance_id: str, hulls: Hulls, /) -> ArticulatedObject | RigidObject: ...
    def choose(self, asset_class: str, which: str, /) -> tuple[str, ...]: ...


def as_task(task: str | TaskSpec | Mapping[str, Any]) -> TaskSpec:
    """Return a task from its name, a spec, or the fields of a spec."""
    if isinstance(task, TaskSpec):
        return task
    if isinstance(task, str):
        return load_task(task)
    if isinstance(task, Mapping):
        return parse_task(dict(task))
    kinds = "the name of a task, a TaskSpec, or a mapping with the fields of a TaskSpec"
    raise InputError(f"must be {kinds}, but is {task!r}", field="task")


def check_names(task: TaskSpec, robot: RobotProfile) -> None:
    """Check that no object has the robot's name, because states of a scene are stored by name."""
    if robot.agent in task.objects:
        raise InputError(f"no object may have the robot's name {robot.agent!r}", field="objects")


def as_library(assets: str | Path | ObjectSource | None) -> ObjectSource:
    if assets is None or isinstance(assets, str | Path):
        return open_library(assets)
    if not all(callable(getattr(assets, name, None)) for name in ("instances", "load", "choose")):
        raise InputError(f"must be None, 'builtin', a folder or an opened library, but is {assets!r}", field="assets")
    return assets


Words = str | Sequence[str]
"""Selection of a class's instances: ``"all"``, ``"train"``, ``"test"``, ``"new"``, an id, or several of these."""


def chosen_instances(
    library: ObjectSource, task: TaskSpec, instances: Words | Mapping[str, Words]
) -> dict[str, tuple[str, ...]]:
    """Return the ids of the instances from which a reset chooses each object.

    Args:
        task: the task, which may allow only some instances of an object.
        instances: one selection for all objects, with instances that the task allows, or a mapping from object names to
            any instances. An object without an entry uses all instances that the task allows.

    Returns:
        Ids by the name of the object.

    Raises:
        InputError: the task has no object of a given name, or an object has no instance to choose from.
    """
    given = dict(instances) if isinstance(instances, Mapping) else {}
    for name in given:
        if name not in task.objects:
            raise InputError(f"there is no object {name!r}", field="instances", remedy=near(name, task.objects))
    chosen: dict[str, tuple[str, ...]] = {}
    classes = {name: spec.asset_class for name, spec in task.objects.items()}
    asked = words_of_objects(
        library.instances, classes, ("all",) if isinstance(instances, Mapping) else _words(instances)
    )
    for name, spec in task.objects.items():
        own = None if name in given or spec.instances is None else spec.words(library.source(spec.asset_class))
        ids = taken_instances(library.choose, spec.asset_class, _words(given.get(name, asked[name])), own)
        if not ids:
            raise InputError(f"the selection contains no instance of {spec.asset_class}", field="instances")
        chosen[name] = ids
    return chosen


def _words(words: object) -> Sequence[str]:
    words = (words,) if isinstance(words, str) else words
    if not isinstance(words, Sequence) or not all(isinstance(word, str) for word in words):
        raise InputError(f"must be text or a list of texts, but is {words!r}", field="instances")
    if "random" in words:
        wrong = "'random' is available only for runs, because the seed of a run selects the object"
        raise InputError(wrong, field="instances", remedy="use 'all': each reset then selects an object at random")
    return words


def check_words(**values: Any) -> None:
    """Check that arguments are None or text."""
    for field, value in values.items():
        if value is not None and not isinstance(value, str):
            raise InputError(f"must be text, but is {value!r}", field=field)

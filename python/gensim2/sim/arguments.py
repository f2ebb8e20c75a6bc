"""What ``gymnasium.make``, ``reset`` and ``step`` are given, checked: nothing odd reaches the simulator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch

from gensim2.errors import InputError
from gensim2.objects import Instance, RigidObject, open_library
from gensim2.objects.library.selection import words_of_objects
from gensim2.robots import RobotProfile
from gensim2.seeding import check_seed
from gensim2.tasks.library import load_task
from gensim2.tasks.parse import parse_task
from gensim2.tasks.spec import TaskSpec


class ObjectSource(Protocol):
    """What the environment needs of an object library."""

    def instances(self, asset_class: str, /) -> tuple[str, ...]: ...
    def load(self, asset_class: str, instance_id: str, /) -> Instance | RigidObject: ...
    def choose(self, asset_class: str, which: str, /) -> tuple[str, ...]: ...


def as_task(task: str | TaskSpec | Mapping[str, Any]) -> TaskSpec:
    """A task by name, as it is, or from its fields."""
    if isinstance(task, TaskSpec):
        return task
    if isinstance(task, str):
        return load_task(task)
    if isinstance(task, Mapping):
        return parse_task(dict(task))
    raise InputError(f"must be a name, a TaskSpec or its fields, is {task!r}", field="task")


def check_names(task: TaskSpec, robot: RobotProfile) -> None:
    """Refuse a task whose object is called as the robot is: states of a scene are kept by name."""
    if robot.agent in task.objects:
        raise InputError(f"no object may be called {robot.agent!r}, as the robot is", field="objects")


def as_library(assets: str | Path | ObjectSource | None) -> ObjectSource:
    """An opened library, or one as :func:`gensim2.objects.open_library` takes it."""
    if assets is None or isinstance(assets, str | Path):
        return open_library(assets)
    if not all(callable(getattr(assets, name, None)) for name in ("instances", "load", "choose")):
        raise InputError(f"must be None, 'builtin', a folder or an opened library, is {assets!r}", field="assets")
    return assets


Words = str | Sequence[str]
"""Which instances of a class: ``"all"``, ``"train"``, ``"test"``, ``"new"``, an id, or several of these."""


def chosen_instances(
    library: ObjectSource, task: TaskSpec, instances: Words | Mapping[str, Words]
) -> dict[str, tuple[str, ...]]:
    """Ids that resets draw from, by object.

    Args:
        library: of the objects.
        task: an object of it may say itself which instances; the others take all.
        instances: of objects by name, in place of what the task says; words alone are about the objects of which the
            task does not say itself which (:func:`~gensim2.objects.library.selection.words_of_objects`).
    """
    given = dict(instances) if isinstance(instances, Mapping) else {}
    for name in given:
        if name not in task.objects:
            known = ", ".join(task.objects)
            raise InputError(f"there is no object {name!r}", field="instances", remedy=f"there are {known}")
    chosen: dict[str, tuple[str, ...]] = {}
    classes = {name: spec.asset_class for name, spec in task.objects.items()}
    asked = words_of_objects(
        library.instances, classes, ("all",) if isinstance(instances, Mapping) else _words(instances)
    )
    for name, spec in task.objects.items():
        words = _words(given.get(name, asked[name] if spec.instances is None else spec.instances))
        ids = tuple(dict.fromkeys(i for word in words for i in library.choose(spec.asset_class, word)))
        if not ids:
            raise InputError(f"no instance of {spec.asset_class} to choose from", field="instances")
        chosen[name] = ids
    return chosen


def _words(words: object) -> Sequence[str]:
    words = (words,) if isinstance(words, str) else words
    if not isinstance(words, Sequence) or not all(isinstance(word, str) for word in words):
        raise InputError(f"must be text or a list of it, is {words!r}", field="instances")
    if "random" in words:
        raise InputError(
            "'random' is one object, drawn by a run's seed, and an environment has none before its first reset",
            field="instances",
            remedy="use 'all': each reset draws one",
        )
    return words


def check_one_of(value: Any, known: Sequence[str], field: str) -> None:
    """Refuse what is not None and none of the known words."""
    if value is not None and value not in known:
        raise InputError(f"must be one of {', '.join(known)}, is {value!r}", field=field)


def check_words(**values: Any) -> None:
    """Refuse arguments that are neither None nor text."""
    for field, value in values.items():
        if value is not None and not isinstance(value, str):
            raise InputError(f"must be text, is {value!r}", field=field)


def checked_seed(seed: Any) -> int | None:
    """The seed of a reset: a whole number, one in a list as vectorized environments give it, or None."""
    if isinstance(seed, list | tuple | np.ndarray) and np.ndim(seed) == 1:
        if len(seed) != 1:
            raise InputError(f"one environment takes one seed, not {len(seed)}", field="seed")
        seed = seed[0]
    return None if seed is None else check_seed(seed)


def checked_action(action: Any, size: int, control_modes: Sequence[str]) -> Any:
    """An action as the simulator takes it: None (no command), (size,) or (1, size) finite numbers.

    ManiSkill's ``{"control_mode": ..., "action": ...}`` goes through with its numbers checked: the size is another.
    """
    if action is None:
        return None
    if isinstance(action, Mapping):
        if set(action) != {"control_mode", "action"}:
            raise InputError("a mapping must hold control_mode and action", field="action")
        check_one_of(action["control_mode"], control_modes, "control_mode")
        return {**action, "action": _finite(action["action"])}
    values = _finite(action)
    if values.shape not in ((size,), (1, size)):
        raise InputError(f"must be {size} numbers, has the shape {tuple(values.shape)}", field="action")
    return values


def _finite(action: Any) -> np.ndarray[Any, np.dtype[np.float32]]:
    try:
        values = np.asarray(action.cpu() if isinstance(action, torch.Tensor) else action, dtype=np.float32)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError("must be numbers", field="action") from error
    if not np.isfinite(values).all():
        raise InputError("must be finite", field="action")
    return values

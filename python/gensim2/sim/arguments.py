"""What ``gymnasium.make``, ``reset`` and ``step`` are given, checked: nothing odd reaches the simulator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch

from gensim2.errors import InputError
from gensim2.objects.types import Instance
from gensim2.seeding import check_seed
from gensim2.tasks.library import load_task, parse_task
from gensim2.tasks.spec import TaskSpec


class ObjectSource(Protocol):
    """What the environment needs of an object library."""

    def instances(self, asset_class: str, /) -> tuple[str, ...]: ...
    def load(self, asset_class: str, instance_id: str, /) -> Instance: ...
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


def as_library(assets: str | Path | ObjectSource | None) -> ObjectSource:
    """An opened library, or one as :func:`gensim2.objects.open_library` takes it."""
    if assets is None or isinstance(assets, str | Path):
        from gensim2.objects import open_library

        return open_library(assets)
    if not all(callable(getattr(assets, name, None)) for name in ("instances", "load", "choose")):
        raise InputError(f"must be None, 'builtin', a folder or an opened library, is {assets!r}", field="assets")
    return assets


def chosen_instances(library: ObjectSource, task: TaskSpec, instances: str | Sequence[str]) -> tuple[str, ...]:
    """Ids that resets draw from: those that one or several words stand for."""
    words = (instances,) if isinstance(instances, str) else instances
    if not isinstance(words, Sequence) or not all(isinstance(word, str) for word in words):
        raise InputError(f"must be text or a list of it, is {instances!r}", field="instances")
    if "random" in words:
        raise InputError(
            "'random' is one object, drawn by a run's seed, and an environment has none before its first reset",
            field="instances",
            remedy="use 'all': each reset draws one",
        )
    chosen = tuple(dict.fromkeys(i for word in words for i in library.choose(task.asset_class, word)))
    if not chosen:
        raise InputError(f"no instance of {task.asset_class} to choose from", field="instances")
    return chosen


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

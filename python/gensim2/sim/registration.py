"""Environment ids for gymnasium."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import WrapperSpec, registry

from gensim2.tasks.library import load_task, packaged_names
from gensim2.tasks.parse import parse_task
from gensim2.tasks.spec import TaskSpec

MODULE = "gensim2.sim"
"""gymnasium imports what stands before a colon in an id; since 1.0 it has no plug-in entry points."""

TASK_ENV_ID = "GenSim2-Task-v1"
"""Takes any task: ``gym.make("GenSim2-Task-v1", task={...})``."""

_ENTRY_POINT = "gensim2.sim.env:GenSim2Env"


def env_id(task: TaskSpec) -> str:
    """Id that ``gym.make`` understands in any process where gensim2 is installed.

    A task that travels with the package has an id of its own; any other goes by ``GenSim2-Task-v1`` with the spec as an
    argument.
    """
    in_library = task.name in packaged_names() and load_task(task.name) == task
    return f"{MODULE}:{task.env_id if in_library else TASK_ENV_ID}"


def make_env(task: str | TaskSpec | Mapping[str, Any], **kwargs: Any) -> gym.Env[Any, Any]:
    """``gymnasium.make`` for a task.

    Args:
        task: name of one of the library, a spec, or its fields.
        kwargs: of ``gymnasium.make`` and of :class:`~gensim2.sim.env.GenSim2Env`: ``assets``, ``obs_mode``, ....

    Raises:
        InputError: there is no such task, or an argument is none of the environment's.
        ImportError: the simulator is not installed.
    """
    if isinstance(task, str):
        task = load_task(task)
    elif not isinstance(task, TaskSpec):
        task = parse_task(dict(task))
    id = env_id(task)
    given: dict[str, Any] = {"task": task} if id.endswith(TASK_ENV_ID) else {}
    return gym.make(id, **given, **kwargs)


def register_all() -> None:
    """Register every task of the package and ``GenSim2-Task-v1``; doing so twice changes nothing."""
    for name in packaged_names():
        task = load_task(name)
        _register(task.env_id, task.max_episode_steps, {"task": name})
    _register(TASK_ENV_ID, None, {})


def _register(id: str, max_episode_steps: int | None, kwargs: dict[str, object]) -> None:
    if id in registry:
        return
    time_limit = WrapperSpec(
        "MSTimeLimit",
        "mani_skill.utils.registration:TimeLimitWrapper",
        {"max_episode_steps": max_episode_steps},
    )
    gym.register(
        id,
        entry_point=_ENTRY_POINT,
        max_episode_steps=max_episode_steps,
        disable_env_checker=True,  # ManiSkill batches every value, which the checker takes for errors
        # The limit of a task that is not in the library is known only to the environment itself.
        additional_wrappers=(time_limit,) if max_episode_steps is not None else (),
        kwargs=dict(kwargs),
    )


def recordable(kwargs: Mapping[str, Any]) -> dict[str, Any]:
    """Environment arguments as a recorder can write them."""
    from gensim2.observations import ObservationSpec

    plain = dict(kwargs)
    if isinstance(plain.get("task"), TaskSpec):
        plain["task"] = plain["task"].model_dump(mode="json")
    if isinstance(plain.get("assets"), Path):
        plain["assets"] = str(plain["assets"])
    if isinstance(plain.get("observation"), ObservationSpec):
        plain["observation"] = plain["observation"].to_dict()
    instances = plain.get("instances")
    if isinstance(instances, Mapping):
        plain["instances"] = {name: _listed(words) for name, words in instances.items()}
    elif instances is not None:
        plain["instances"] = _listed(instances)
    return plain


def _listed(words: str | Sequence[str]) -> str | list[str]:
    return words if isinstance(words, str) else list(words)

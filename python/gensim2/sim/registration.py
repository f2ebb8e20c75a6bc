"""Register environment ids with gymnasium."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec, WrapperSpec, registry

from gensim2.core.errors import InputError
from gensim2.scenes.physics import Engine, default_engine
from gensim2.tasks.library import load_task, packaged_names
from gensim2.tasks.parse import parse_task
from gensim2.tasks.spec import TaskSpec

MODULE = "gensim2.sim"
"""Module that gymnasium imports, named before the colon in an id; since 1.0 gymnasium has no plug-in entry points."""

TASK_ENV_ID = "GenSim2-Task-v1"
"""Id of the environment that takes any task: ``gym.make("GenSim2-Task-v1", task={...})``."""

NUMPY_ENV_ID = "GenSim2-Numpy-v1"
"""Id of the :class:`~gensim2.sim.numpy_env.NumpyEnv` that takes any task."""

_ENTRY_POINT = "gensim2.sim.env:GenSim2Env"


def env_id(task: TaskSpec) -> str:
    """Return the environment id of a task for ``gym.make``. The id is valid in any process that can import gensim2.

    Each task of the package has an id; any other task uses ``GenSim2-Task-v1`` with the spec as an argument.

    Example:
        ```python
        env = gymnasium.make(env_id(gensim2.load_task("OpenDrawer")), assets="builtin")
        ```
    """
    in_library = task.name in packaged_names() and load_task(task.name) == task
    return f"{MODULE}:{task.env_id if in_library else TASK_ENV_ID}"


_UNBATCHED = WrapperSpec("Unbatched", "gensim2.sim.unbatched:Unbatched", {})


def make_env(
    task: str | TaskSpec | Mapping[str, Any], *, numpy: bool = False, engine: Engine | None = None, **kwargs: Any
) -> gym.Env[Any, Any]:
    """Create the gymnasium environment of a task.

    Example:
        ```python
        env = gensim2.make_env("OpenDrawer", assets="builtin", obs_mode="raycast")
        obs, info = env.reset(seed=7)
        obs, reward, terminated, truncated, info = env.step(env.action_space.sample())
        ```

    Args:
        task: name of a library task, a spec, or its fields.
        engine: ``"sapien"`` (ManiSkill) or ``"mujoco"`` (NumPy, without a batch axis). Default: SAPIEN if it is
            installed.
        numpy: whether a ManiSkill environment returns NumPy values without a batch axis, as a MuJoCo environment always
            does.
        kwargs: keyword arguments of ``gymnasium.make`` and of :class:`~gensim2.sim.env.GenSim2Env` or
            :class:`~gensim2.sim.numpy_env.NumpyEnv`, for example ``assets``, ``instances``, ``physics``, ``robot``,
            ``randomization``, ``obs_mode`` and ``reward_mode``.

    Returns:
        The environment, which wraps a :class:`~gensim2.sim.env.GenSim2Env` or a
        :class:`~gensim2.sim.numpy_env.NumpyEnv`.

    Raises:
        InputError: the task or an argument is unknown.
        ImportError: the simulator is not installed.
    """
    if (engine or default_engine()) == "mujoco":
        return gym.make(NUMPY_ENV_ID, task=task, engine="mujoco", **kwargs)
    id, given = _id_and_arguments(task)
    if engine is not None:
        kwargs["engine"] = engine
    return gym.make(_unbatched_spec(id) if numpy else id, **given, **kwargs)


def make_vec_env(
    task: str | TaskSpec | Mapping[str, Any],
    num_envs: int,
    vectorization_mode: str = "async",
    *,
    engine: Engine | None = None,
    vector_kwargs: Mapping[str, Any] | None = None,
    wrappers: Sequence[Callable[[gym.Env[Any, Any]], gym.Wrapper[Any, Any, Any, Any]]] = (),
    **kwargs: Any,
) -> gym.vector.VectorEnv[Any, Any, Any]:
    """Create several environments of a task as one vector environment.

    Create a vector environment of single environments, each as made by :func:`make_env` with ``numpy=True``.

    Example:
        ```python
        envs = gensim2.make_vec_env("OpenDrawer", 4, assets="builtin")
        obs, info = envs.reset(seed=[0, 1, 2, 3])
        ```

    Args:
        task: as for :func:`make_env`.
        num_envs: number of environments, n.
        vectorization_mode: ``"async"`` (one process each), ``"sync"``, or ``"thread"`` (one thread each, ``mujoco``
            only).
        engine: as for :func:`make_env`.
        vector_kwargs: keyword arguments of gymnasium's vector class.
        wrappers: functions that wrap each environment; the first one is the innermost.
        kwargs: as for :func:`make_env`; they apply to all environments.

    Returns:
        The vector environment; observations, rewards and flags are NumPy arrays (n, ...).

    Raises:
        InputError: the task, the mode or an argument is unknown.
        ImportError: the simulator is not installed.
    """
    if vectorization_mode not in ("async", "sync", "thread"):
        raise InputError(f"must be async, sync or thread, but is {vectorization_mode!r}", field="vectorization_mode")
    if not isinstance(num_envs, int) or isinstance(num_envs, bool) or num_envs < 1:
        raise InputError(f"must be a whole number and at least 1, but is {num_envs!r}", field="num_envs")
    if (engine or default_engine()) == "mujoco":
        kwargs |= {"task": task, "engine": "mujoco"}
        if vectorization_mode == "thread":
            from gensim2.sim.threads import ThreadVectorEnv

            maker = partial(_wrapped, wrappers, kwargs)
            return ThreadVectorEnv([maker] * num_envs, **(vector_kwargs or {}))
        return gym.make_vec(NUMPY_ENV_ID, num_envs, vectorization_mode, dict(vector_kwargs or {}), wrappers, **kwargs)
    if vectorization_mode == "thread":
        raise InputError("thread needs the engine mujoco", field="vectorization_mode", remedy="use async or sync")
    id, given = _id_and_arguments(task)
    envs = gym.make_vec(
        _unbatched_spec(id), num_envs, vectorization_mode, dict(vector_kwargs or {}), wrappers, **given, **kwargs
    )
    spec = envs.unwrapped.spec
    assert spec is not None, "gymnasium describes what it makes"
    # gymnasium passes these arguments on, but does not store them in the spec of the vector environment.
    for name in ("max_episode_steps", "disable_env_checker"):
        if kwargs.get(name) is not None:
            setattr(spec, name, kwargs[name])
    return envs


def _wrapped(wrappers: Sequence[Callable[[Any], Any]], kwargs: Mapping[str, Any]) -> gym.Env[Any, Any]:
    env: gym.Env[Any, Any] = gym.make(NUMPY_ENV_ID, **kwargs)
    for wrapper in wrappers:
        env = wrapper(env)
    return env


def _id_and_arguments(task: str | TaskSpec | Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    if isinstance(task, str):
        task = load_task(task)
    elif not isinstance(task, TaskSpec):
        task = parse_task(dict(task))
    id = env_id(task)
    return id, {"task": task} if id.endswith(TASK_ENV_ID) else {}


def _unbatched_spec(id: str) -> EnvSpec:
    spec = copy.deepcopy(gym.spec(id.removeprefix(f"{MODULE}:")))
    spec.additional_wrappers += (_UNBATCHED,)
    return spec


def register_all() -> None:
    """Register every task of the package and ``GenSim2-Task-v1``. Further calls have no effect.

    Example:
        ```python
        register_all()    # importing gensim2.sim does this
        env = gymnasium.make("GenSim2-OpenDrawer-v1", assets="builtin")
        ```
    """
    for name in packaged_names():
        task = load_task(name)
        _register(task.env_id, task.max_episode_steps, {"task": name})
    _register(TASK_ENV_ID, None, {})
    if NUMPY_ENV_ID not in registry:
        gym.register(NUMPY_ENV_ID, entry_point="gensim2.sim.numpy_env:NumpyEnv")


def _register(id: str, max_episode_steps: int | None, kwargs: dict[str, object]) -> None:
    if id in registry:
        return
    time_limit = WrapperSpec("TimeLimit", "gensim2.sim.time_limit:TimeLimit", {"registered": max_episode_steps})
    gym.register(
        id,
        entry_point=_ENTRY_POINT,
        max_episode_steps=max_episode_steps,
        disable_env_checker=True,  # the checker rejects ManiSkill's batched values
        additional_wrappers=(time_limit,),
        kwargs=dict(kwargs),
    )


def recordable(kwargs: Mapping[str, Any]) -> dict[str, Any]:
    """Convert the arguments of an environment to plain data that ManiSkill's trajectory recorder can write to JSON."""
    from gensim2.perception import ObservationSpec

    plain = dict(kwargs)
    if isinstance(plain.get("task"), TaskSpec):
        plain["task"] = plain["task"].model_dump(mode="json")
    assets = plain.get("assets")
    # ``assets`` is a pathlib.Path or an opened library, which JSON cannot store.
    if assets is not None and not isinstance(assets, str):
        plain["assets"] = str(getattr(assets, "location", assets))
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

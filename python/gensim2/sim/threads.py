"""Provide a gymnasium vector environment whose environments run in threads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import gymnasium as gym
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from gensim2.core.errors import InputError


class _Done(gym.Wrapper[Any, Any, Any, Any]):
    """Placeholder for an environment.

    Its ``reset`` and ``step`` return a thread's result to gymnasium's ``SyncVectorEnv``.
    """

    def __init__(self, env: gym.Env[Any, Any], result: Any) -> None:
        super().__init__(env)
        self._results = [result]

    def step(self, action: Any) -> Any:
        return self._results.pop()

    def reset(self, **given: Any) -> Any:
        return self._results.pop() if self._results else self.env.reset(**given)


class ThreadVectorEnv(SyncVectorEnv):
    """Vector environment that runs in threads.

    The threads run in parallel because MuJoCo releases the interpreter lock.

    Args:
        makers: for each environment, a function that creates it.
        kwargs: additional arguments of gymnasium's ``SyncVectorEnv``.
    """

    def __init__(self, makers: Sequence[Callable[[], gym.Env[Any, Any]]], **kwargs: Any) -> None:
        super().__init__(makers, **kwargs)
        self._threads = ThreadPoolExecutor(len(makers))

    def step(self, actions: Any) -> Any:
        """Step all environments; an environment whose episode has ended is reset, as in ``SyncVectorEnv``."""
        again = self._autoreset_envs if self.autoreset_mode == AutoresetMode.NEXT_STEP else [False] * self.num_envs
        rows = list(gym.vector.utils.iterate(self.action_space, actions))

        def advance(index: int) -> Any:
            env = self.envs[index]
            return env.reset() if again[index] else env.step(rows[index])

        return self._with(list(self._threads.map(advance, range(self.num_envs))), super().step, actions)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> Any:
        """Reset the environments of ``options["reset_mask"]``, or all. Environment k gets ``seed + k``."""
        if options is not None and "reset_mask" in options:
            return super().reset(seed=seed, options=options)
        seeds = [seed + i for i in range(self.num_envs)] if isinstance(seed, int) else seed or [None] * self.num_envs
        if len(seeds) != self.num_envs:
            wrong = f"must contain {self.num_envs} seeds, one for each environment, but contains {len(seeds)}"
            raise InputError(wrong, field="seed")
        made = self._threads.map(
            lambda pair: pair[0].reset(seed=pair[1], options=options), zip(self.envs, seeds, strict=True)
        )
        return self._with(list(made), super().reset)

    def _with(self, results: list[Any], function: Callable[..., Any], *arguments: Any) -> Any:
        """Call a method of the base class with placeholders that return ``results``."""
        envs = self.envs
        self.envs = [_Done(env, result) for env, result in zip(envs, results, strict=True)]
        try:
            return function(*arguments)
        finally:
            self.envs = envs

    def close_extras(self, **kwargs: Any) -> None:
        """Stop the threads and close the environments."""
        self._threads.shutdown()
        super().close_extras(**kwargs)

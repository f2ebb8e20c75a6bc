"""Limit the length of episodes. ``truncated`` is a tensor with a batch axis, as ManiSkill's tools require."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils import RecordConstructorArgs


class TimeLimit(gym.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """Wrapper like gymnasium's ``TimeLimit``. Its ``truncated`` is a tensor, as ManiSkill requires.

    Args:
        env: environment of ``gymnasium.make``. If it has gymnasium's ``TimeLimit``, this wrapper replaces that one and
            its limit.
        registered: registered step limit of the task. If ``env`` has this limit, the caller has set none, and the limit
            follows from the task's time limit and the robot's control rate.
    """

    def __init__(self, env: gym.Env[Any, Any], registered: int | None = None) -> None:
        asked = None
        if isinstance(env, gym.wrappers.TimeLimit):
            asked, env = env._max_episode_steps, env.env
        RecordConstructorArgs.__init__(self, registered=registered)
        gym.Wrapper.__init__(self, env)
        own = int(self.unwrapped.max_episode_steps)  # type: ignore[attr-defined]
        self._max_episode_steps = own if asked is None or asked == registered else int(asked)

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]  # a property in gymnasium's wrappers
        """Spec of the environment. Its ``max_episode_steps`` is the step limit of this wrapper."""
        spec = super().spec
        if spec is not None:
            spec.max_episode_steps = self._max_episode_steps
        return spec

    def step(self, action: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Execute one control step. ``truncated``, a bool tensor (1,), is True once the step limit is reached."""
        obs, reward, terminated, _, info = self.env.step(action)
        truncated: Any = self.unwrapped.elapsed_steps >= self._max_episode_steps  # type: ignore[attr-defined]
        return obs, reward, terminated, truncated, info

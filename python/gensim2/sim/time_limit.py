"""Truncation of episodes after a number of control steps, in batched values as ManiSkill's tools take them."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec


class TimeLimit(gym.Wrapper[Any, Any, Any, Any]):
    """Takes the place of gymnasium's own wrapper, whose ``truncated`` is no tensor.

    Args:
        env: as ``gymnasium.make`` made it; where that put its own wrapper around it, this one does its work.
        registered: control steps with which the id is registered; the environment knows them for its robot's rate.
    """

    def __init__(self, env: gym.Env[Any, Any], registered: int | None = None) -> None:
        asked = None
        if isinstance(env, gym.wrappers.TimeLimit):
            asked, env = env._max_episode_steps, env.env
        super().__init__(env)
        own = int(self.unwrapped.max_episode_steps)  # type: ignore[attr-defined]
        self._max_episode_steps = own if asked is None or asked == registered else int(asked)

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]  # of a wrapper it is a property
        """The environment's, with the limit that holds here."""
        spec = super().spec
        if spec is not None:
            spec.max_episode_steps = self._max_episode_steps
        return spec

    def step(self, action: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """One control step; ``truncated`` (1,) bool once there have been so many."""
        obs, reward, terminated, _, info = self.env.step(action)
        truncated: Any = self.unwrapped.elapsed_steps >= self._max_episode_steps  # type: ignore[attr-defined]
        return obs, reward, terminated, truncated, info

"""Convert ManiSkill environments to plain gymnasium environments of NumPy values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import RecordConstructorArgs


class Unbatched(gym.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """Wrapper that removes the leading axis of length one from ManiSkill's values, and converts tensors to arrays.

    Rewards become floats, flags become bools, and single values in ``info`` become Python numbers. Arrays are copies.

    Args:
        env: environment whose observations, rewards, flags and pictures have a leading axis of length one.

    Example:
        ```python
        env = Unbatched(gensim2.make_env("OpenDrawer"))    # the same as gensim2.make_env("OpenDrawer", numpy=True)
        obs, info = env.reset(seed=7)
        ```
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        RecordConstructorArgs.__init__(self)
        gym.Wrapper.__init__(self, env)
        self.observation_space = _unbatched_space(env.observation_space)
        # Offer only the mode rgb_array: other render modes open a window or need cameras in the observation.
        modes = [mode for mode in env.metadata["render_modes"] if mode == "rgb_array"]
        self.metadata = {**env.metadata, "render_modes": modes}

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment and return its first observation and information."""
        obs, info = self.env.reset(seed=seed, options=options)
        return _unbatched(obs), _plain(_unbatched(info))

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Execute one control step."""
        obs, reward, terminated, truncated, info = self.env.step(action)
        return _unbatched(obs), float(reward), bool(terminated), bool(truncated), _plain(_unbatched(info))

    def render(self) -> Any:
        """Return the picture, (H, W, 3) uint8; None if the environment's render mode returns no picture."""
        return _unbatched(self.env.render())


def _unbatched(value: Any) -> Any:
    """Remove the batch axis: return the only row of a tensor or array. Return any other value unchanged."""
    if isinstance(value, Mapping):
        return {name: _unbatched(each) for name, each in value.items()}
    if isinstance(value, np.ndarray) or hasattr(value, "cpu"):
        array = np.asarray(value.cpu() if hasattr(value, "cpu") else value)
        return array[0].copy()
    return value


def _plain(value: Any) -> Any:
    """Convert NumPy scalars to Python numbers, also inside mappings. Return any other value unchanged."""
    if isinstance(value, Mapping):
        return {name: _plain(each) for name, each in value.items()}
    return value.item() if isinstance(value, np.generic) else value


def _unbatched_space(space: gym.Space[Any]) -> gym.Space[Any]:
    if isinstance(space, gym.spaces.Dict):
        return gym.spaces.Dict({name: _unbatched_space(each) for name, each in space.items()})
    assert isinstance(space, gym.spaces.Box), "all observations are arrays"
    return gym.spaces.Box(space.low[0], space.high[0], space.shape[1:], space.dtype.type)

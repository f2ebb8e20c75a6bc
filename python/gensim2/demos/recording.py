"""One recorded episode as a plain value that pickles; its arrays follow ManiSkill's trajectory format."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from gensim2.sim.env import GenSim2Env

Tree = dict[str, Any]
"""Arrays by name, nested; leaves are numpy arrays whose first axis is time."""


@dataclass(frozen=True)
class Recording:
    """Everything that ManiSkill's tools need to replay an episode, with T steps.

    Attributes:
        seed: of the reset.
        reset_options: the options of the reset, and which instance stood there; the rest follows from the
            seed.
        control_mode: of the actions.
        actions: (T, 8) float32.
        obs: (T + 1, D) float32 state observations.
        env_states: tree of (T + 1, ...) float32.
        rewards: (T,) float32.
        terminated, truncated, success: (T,) bool.
        openness: (T + 1,) float32.
    """

    seed: int
    reset_options: dict[str, Any]
    control_mode: str
    actions: npt.NDArray[np.float32]
    obs: npt.NDArray[np.float32]
    env_states: Tree
    rewards: npt.NDArray[np.float32]
    terminated: npt.NDArray[np.bool_]
    truncated: npt.NDArray[np.bool_]
    success: npt.NDArray[np.bool_]
    openness: npt.NDArray[np.float32]

    @property
    def steps(self) -> int:
        """Number of control steps."""
        return len(self.actions)


class Recorder:
    """Collects an episode from a fresh reset on.

    Args:
        env: has just been reset; its observations are vectors (``obs_mode="state"``).
    """

    def __init__(self, env: GenSim2Env) -> None:
        self._env = env
        self._obs = [_row(env.get_obs())]
        self._states = [_to_numpy(env.get_state_dict())]
        self._openness = [env.openness]
        self._actions: list[npt.NDArray[np.float32]] = []
        self._rewards: list[float] = []
        self._flags: list[tuple[bool, bool, bool]] = []

    def add(
        self,
        action: npt.NDArray[np.float32],
        obs: Any,
        reward: Any,
        terminated: Any,
        truncated: Any,
        info: Any,
    ) -> None:
        """Take one step's outcome, as ``env.step`` returned it."""
        self._actions.append(np.array(action, dtype=np.float32))
        self._obs.append(_row(obs))
        self._states.append(_to_numpy(self._env.get_state_dict()))
        self._openness.append(self._env.openness)
        self._rewards.append(float(reward[0]))
        self._flags.append((bool(terminated[0]), bool(truncated[0]), bool(info["success"][0])))

    def finish(self) -> Recording:
        """Return what was collected."""
        flags = np.array(self._flags, dtype=bool)
        return Recording(
            seed=int(self._env._episode_seed[0]),
            reset_options=_plain({**self._env.reset_options, "instance": self._env._require_instance().id}),
            control_mode=self._env.control_mode,
            actions=np.stack(self._actions),
            obs=np.stack(self._obs),
            env_states=_stack(self._states),
            rewards=np.array(self._rewards, dtype=np.float32),
            terminated=flags[:, 0],
            truncated=flags[:, 1],
            success=flags[:, 2],
            openness=np.array(self._openness, dtype=np.float32),
        )


def _plain(options: dict[str, Any]) -> dict[str, Any]:
    """Reset options as JSON holds them: numbers and arrays of any kind as floats and lists."""
    return {
        key: value if value is None or isinstance(value, str) else np.asarray(value, dtype=np.float64).tolist()
        for key, value in options.items()
    }


def _row(obs: Any) -> npt.NDArray[np.float32]:
    return np.asarray(obs[0].numpy(), dtype=np.float32)


def _to_numpy(tree: Any) -> Any:
    if isinstance(tree, dict):
        return {key: _to_numpy(value) for key, value in tree.items()}
    return tree[0].numpy().astype(np.float32)


def _stack(trees: list[Any]) -> Any:
    if isinstance(trees[0], dict):
        return {key: _stack([tree[key] for tree in trees]) for key in trees[0]}
    return np.stack(trees)

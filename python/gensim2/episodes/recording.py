"""One recorded episode as a plain value that pickles; its arrays follow ManiSkill's trajectory format."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from gensim2.sim.lane import Lane

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
        lane: has just been reset.
    """

    def __init__(self, lane: Lane) -> None:
        self._lane = lane
        self._obs = [lane.observation()]
        self._states: list[Tree] = [lane.state()]
        self._openness = [lane.openness]
        self._actions: list[npt.NDArray[np.float32]] = []
        self._success: list[bool] = []
        self._truncated: list[bool] = []

    def add(self, action: npt.NDArray[np.float32]) -> None:
        """Take what came of one step."""
        lane = self._lane
        self._actions.append(np.array(action, dtype=np.float32))
        self._obs.append(lane.observation())
        self._states.append(lane.state())
        self._openness.append(lane.openness)
        self._success.append(lane.success)
        self._truncated.append(lane.elapsed_steps >= lane.max_episode_steps)

    def finish(self) -> Recording:
        """Return what was collected; rewards and ends are those of the registered environment."""
        success = np.array(self._success, dtype=bool)
        return Recording(
            seed=self._lane.seed,
            reset_options=_plain({**self._lane.reset_options, "instance": self._lane.instance.id}),
            control_mode=self._lane.control_mode,
            actions=np.stack(self._actions),
            obs=np.stack(self._obs),
            env_states=_stack(self._states),
            rewards=success.astype(np.float32),
            terminated=success,
            truncated=np.array(self._truncated, dtype=bool),
            success=success,
            openness=np.array(self._openness, dtype=np.float32),
        )


def _plain(options: dict[str, Any]) -> dict[str, Any]:
    """Reset options as JSON holds them: numbers and arrays of any kind as floats and lists."""
    return {
        key: value if value is None or isinstance(value, str) else np.asarray(value, dtype=np.float64).tolist()
        for key, value in options.items()
    }


def _stack(trees: list[Any]) -> Any:
    if isinstance(trees[0], dict):
        return {key: _stack([tree[key] for tree in trees]) for key in trees[0]}
    return np.stack(trees)

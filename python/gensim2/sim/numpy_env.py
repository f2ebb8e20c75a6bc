"""Provide a gymnasium environment without ManiSkill. Its observations are arrays without a batch axis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from gensim2.core.errors import ClosedEnvError, InputError
from gensim2.core.seeding import LARGEST_SEED
from gensim2.perception import ObservationSpec
from gensim2.perception.raycast.state_drawing import StateDrawing
from gensim2.scenes.config import SceneConfig
from gensim2.sim.drawing import state_drawing
from gensim2.sim.driver import renderer
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.reward import StagedReward
from gensim2.tasks.spec import TaskSpec

OBS_MODES = ("state", "raycast")
REWARD_MODES = ("sparse", "normalized_dense")

Observed = npt.NDArray[np.float32] | dict[str, npt.NDArray[Any]]


class NumpyEnv(gym.Env[Any, npt.NDArray[np.float32]]):
    """Gymnasium environment of a task with NumPy arrays, simulated by :class:`~gensim2.sim.headless.HeadlessEnv`.

    Example:
        ```python
        env = gensim2.make_env("OpenDrawer", engine="mujoco", assets="builtin", render_mode="rgb_array")
        obs, info = env.reset(seed=7)
        obs, reward, terminated, truncated, info = env.step(env.action_space.sample())
        picture = env.render()  # (480, 640, 3) uint8
        ```

    Args:
        task: name of a library task, a :class:`TaskSpec`, its fields, or a :class:`~gensim2.scenes.config.SceneConfig`.
        obs_mode: ``"state"`` gives a vector (D,) of float32; ``"raycast"`` gives the arrays of an
            :class:`~gensim2.perception.Observation`.
        observation: :class:`~gensim2.perception.ObservationSpec` or its fields, for ``"raycast"``.
        reward_mode: ``"sparse"`` (1 if the goal is reached, else 0) or ``"normalized_dense"`` (0 to 1).
        render_mode: ``"rgb_array"`` or None. Pictures come from the engine's renderer. If that renderer does not work,
            they come from the ray caster. ``reset`` reports the renderer and the reason in ``info["renderer"]``.
        scene: see :class:`~gensim2.scenes.config.SceneArguments`.

    Raises:
        InputError: an argument is invalid.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"]}  # noqa: RUF012 - as gymnasium declares it

    def __init__(
        self,
        task: str | TaskSpec | Mapping[str, Any] | SceneConfig,
        *,
        obs_mode: str = "state",
        observation: ObservationSpec | Mapping[str, Any] | None = None,
        reward_mode: str = "sparse",
        render_mode: str | None = None,
        **scene: Any,
    ) -> None:
        for field, value, known in (
            ("obs_mode", obs_mode, OBS_MODES),
            ("reward_mode", reward_mode, REWARD_MODES),
            ("render_mode", render_mode, (None, *self.metadata["render_modes"])),
        ):
            if value not in known:
                raise InputError(f"must be one of {', '.join(map(str, known))}, but is {value!r}", field=field)
        if observation is not None and obs_mode != "raycast":
            raise InputError("is used only with obs_mode='raycast'", field="observation")
        self.headless = HeadlessEnv(task, **scene)
        self.metadata = {**self.metadata, "render_fps": self.headless.profile.control_hz}
        self.render_mode = render_mode
        self._spec = observation if isinstance(observation, ObservationSpec) else ObservationSpec.of(observation or {})
        self._sees, self._is_dense = obs_mode == "raycast", reward_mode == "normalized_dense"
        self._drawing: StateDrawing | None = None
        self._closed = False
        profile = self.headless.profile
        size, limits = profile.arm_size, profile.model
        low, high = np.full(size + 1, -1.0, np.float32), np.ones(size + 1, np.float32)
        low[:size], high[:size] = limits.lower[:size], limits.upper[:size]
        self.action_space = gym.spaces.Box(low, high, dtype=np.float32)
        self.headless.reset(0)
        self.observation_space = _space(self._observed())

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Observed, dict[str, Any]]:
        """Build a new scene; the same seed gives the same scene.

        Args:
            seed: 0 to 2**32 - 1; None selects a random seed.
            options: reset options, as for :class:`~gensim2.sim.headless.HeadlessEnv`.

        Raises:
            InputError: the seed or an option is invalid.
        """
        self._require_open()
        super().reset(seed=seed)
        self.headless.reset(int(self.np_random.integers(LARGEST_SEED)) if seed is None else seed, options)
        self._reward = StagedReward(self.headless.task)
        self._close_drawing()
        info = self._info(self.headless.success)
        if self.render_mode is not None:
            info["renderer"] = renderer(self.headless.engine).reason
        return self._observed(), info

    def step(self, action: npt.NDArray[np.float32]) -> tuple[Observed, float, bool, bool, dict[str, Any]]:
        """Make one control step.

        Args:
            action: (m + 1,) targets of the m arm joints in rad, and the gripper from -1 (closed) to 1 (open).

        Raises:
            InputError: the action has the wrong shape or is not finite.
        """
        self._require_open()
        env = self.headless
        env.step(action)
        success = env.success
        reward = self._reward.of(env.measure()) if self._is_dense else float(success)
        truncated = env.elapsed_steps >= env.max_episode_steps
        return self._observed(), reward, success, truncated, self._info(success)

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Return a picture (480, 640, 3) of this instant; None without a render mode."""
        self._require_open()
        if self.render_mode is None:
            return None
        env = self.headless
        if self._drawing is None:
            models = {name: thing.model for name, thing in env.initial_state.objects.items()}
            self._drawing = state_drawing(env.engine, env.profile, models)
        rows = {kind: {name: row[None] for name, row in group.items()} for kind, group in env.state().items()}
        return self._drawing.of(rows)

    def close(self) -> None:
        """Close the environment and release its resources."""
        self._close_drawing()
        self.headless.close()
        self._closed = True

    def _close_drawing(self) -> None:
        if self._drawing is not None:
            self._drawing.close()
            self._drawing = None

    def _require_open(self) -> None:
        if self._closed:
            raise ClosedEnvError("the environment is closed")

    def _observed(self) -> Observed:
        if self._sees:
            return {name: np.ascontiguousarray(array) for name, array in self.headless.observe(self._spec).items()}
        return self.headless.observation()

    def _info(self, success: bool) -> dict[str, Any]:
        return {"success": success, "elapsed_steps": self.headless.elapsed_steps}


def _space(observed: Observed) -> gym.Space[Any]:
    if isinstance(observed, dict):
        return gym.spaces.Dict({name: _space(array) for name, array in observed.items()})
    kind: Any = observed.dtype
    low, high = (np.iinfo(kind).min, np.iinfo(kind).max) if kind.kind in "iu" else (-np.inf, np.inf)
    return gym.spaces.Box(low, high, observed.shape, kind.type)

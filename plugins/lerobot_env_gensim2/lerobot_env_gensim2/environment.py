"""One task as a Gymnasium environment that LeRobot's scripts can run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from gensim2.evaluation.films import film_camera, shaded
from gensim2.observations import ObservationSpec
from gensim2.observations.columns import CLOUD, GRIPPER, STATE, TOOL_POSE, VELOCITY
from gensim2.raycast.scene import RaycastScene
from gensim2.rollout.run import GOAL_SECONDS
from gensim2.scenes.config import SceneArguments
from gensim2.sim.headless import HeadlessEnv

Seen = dict[str, npt.NDArray[np.float32]]

WIDEST = 10.0
"""Of all that is observed, in SI units."""


class GenSim2Gym(gym.Env[Seen, npt.NDArray[np.float32]]):
    """Random scenes of one task.

    An episode ends where the goal has held for half a second, which is ``info["is_success"]``, and is cut at the
    task's step limit. `gensim2 evaluate` asks for more: a scene at rest, and a goal that does not come by itself.

    Args:
        task: name of a library task, or a folder that holds task.yaml.
        spec: what is seen; a point cloud is part of it.
        scene: keywords of the scenes.
    """

    render_mode = "rgb_array"

    def __init__(self, task: str, spec: ObservationSpec, scene: SceneArguments) -> None:
        from gensim2.rollout.inputs import task_and_strategies

        self._env = HeadlessEnv(task_and_strategies(task)[0], **scene)
        self._spec = spec
        profile = self._env.profile
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": round(profile.control_hz)}
        self.task, self.task_description = self._env.task.name, self._env.task.description
        self._max_episode_steps = self._env.max_episode_steps
        self._lasting = profile.steps(GOAL_SECONDS)
        n = len(profile.reset_qpos)
        shapes = {STATE: (n,), VELOCITY: (n,), TOOL_POSE: (7,), GRIPPER: (2,), CLOUD: (spec.cloud.points, 6)}
        self.observation_space = gym.spaces.Dict(
            {name: gym.spaces.Box(-WIDEST, WIDEST, shape, np.float32) for name, shape in shapes.items()}
        )
        arm = list(profile.arm_columns)
        low, high = profile.model.lower[arm], profile.model.upper[arm]
        self.action_space = gym.spaces.Box(np.append(low, -1.0), np.append(high, 1.0), dtype=np.float32)

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Seen, dict[str, Any]]:
        """Build the scene of a seed; without one, of one that is drawn."""
        super().reset(seed=seed)
        self._env.reset(int(self.np_random.integers(2**32)) if seed is None else seed)
        self._held_for = 0
        self._pictures: RaycastScene | None = None
        return self._seen(), {"is_success": False}

    def step(self, action: npt.NDArray[np.float32]) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        """Take joint targets in rad and the gripper from -1 to 1; the reward is 1 where the episode succeeds."""
        self._env.step(action)
        self._held_for = self._held_for + 1 if self._env.success else 0
        success = self._held_for >= self._lasting
        cut = self._env.elapsed_steps >= self._max_episode_steps
        return self._seen(), float(success), success, cut and not success, {"is_success": success}

    def render(self) -> npt.NDArray[np.uint8]:
        """Return a picture (H, W, 3), ray-cast: no renderer is needed."""
        profile = self._env.profile
        if self._pictures is None:
            models = {name: thing.model for name, thing in self._env.initial_state.objects.items()}
            self._pictures = RaycastScene(profile, models, [film_camera(profile)])
        rows = {kind: {name: row[None] for name, row in group.items()} for kind, group in self._env.state().items()}
        return shaded(self._pictures.see(self._pictures.poses(rows)[0])[0])

    def close(self) -> None:
        """Give up what it holds."""
        self._env.close()

    def _seen(self) -> Seen:
        seen = self._env.observe(self._spec)
        return {name: np.asarray(seen[name], dtype=np.float32) for name in self.observation_space}

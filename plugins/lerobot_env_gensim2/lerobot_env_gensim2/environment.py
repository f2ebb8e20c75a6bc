"""One task as a Gymnasium environment that LeRobot's scripts can run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from gensim2.data.films import film_camera
from gensim2.perception import EmptyCloudError, ObservationSpec
from gensim2.perception.observation import CLOUD, ENVIRONMENT_STATE, GRIPPER, STATE, TOOL_POSE, VELOCITY
from gensim2.perception.raycast.drawing import shaded
from gensim2.perception.raycast.scene import RaycastScene
from gensim2.rollout.motion import GOAL_SECONDS, MAX_SETTLE_SECONDS, is_stable, settle
from gensim2.scenes.config import SceneArguments
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.measurement import Measurement

Seen = dict[str, npt.NDArray[np.float32]]

LEROBOT_OPTIONS = "lerobot_"
"""Beginning of the names of reset options that LeRobot's rollouts give, such as ``lerobot_new_rollout``."""
WIDEST = 10.0
"""Of all that is observed, in SI units."""


class GenSim2Gym(gym.Env[Seen, npt.NDArray[np.float32]]):
    """Random scenes of one task.

    An episode ends as in `gensim2 evaluate --stop goal`: where the goal has held for half a second, the last action is
    held until the scene has settled, and where the goal was lost meanwhile, the episode goes on. At the task's step
    limit, less the time to settle, and where the cameras see nothing any more, the scene settles and the episode is
    judged. ``info["is_success"]``: the goal holds in a scene at rest. Whether it comes by itself, only `gensim2
    evaluate` asks.

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
        self._max_episode_steps = self._env.max_episode_steps - profile.steps(MAX_SETTLE_SECONDS)
        self._lasting = profile.steps(GOAL_SECONDS)
        n = len(profile.reset_qpos)
        shapes = {STATE: (n,), VELOCITY: (n,), TOOL_POSE: (7,), GRIPPER: (2,), CLOUD: (spec.cloud.points, 6)}
        if spec.is_privileged:
            shapes[ENVIRONMENT_STATE] = (3 * spec.cloud.points,)
        self.observation_space = gym.spaces.Dict(
            {name: gym.spaces.Box(-WIDEST, WIDEST, shape, np.float32) for name, shape in shapes.items()}
        )
        arm = list(profile.arm_columns)
        low, high = profile.model.lower[arm], profile.model.upper[arm]
        self.action_space = gym.spaces.Box(np.append(low, -1.0), np.append(high, 1.0), dtype=np.float32)

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Seen, dict[str, Any]]:
        """Build the scene of a seed; without one, of one that is drawn.

        Args:
            seed: of the scene.
            options: those of HeadlessEnv's reset; LeRobot's own, which are for its wrappers, are left out.
        """
        super().reset(seed=seed)
        given = {name: value for name, value in (options or {}).items() if not name.startswith(LEROBOT_OPTIONS)}
        self._env.reset(int(self.np_random.integers(2**32)) if seed is None else seed, given)
        self._held_for = 0
        self._pictures: RaycastScene | None = None
        self._last_seen = self._seen()
        return self._last_seen, {"is_success": False}

    def step(self, action: npt.NDArray[np.float32]) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        """Take joint targets in rad and the gripper from -1 to 1; the reward is 1 where the episode succeeds."""
        action = np.asarray(action, dtype=np.float32)
        self._env.step(action)
        self._held_for = self._held_for + 1 if self._env.success else 0
        lasted = self._held_for >= self._lasting
        settles = lasted or self._is_cut
        at_rest = settles and self._settle(action)
        if lasted:
            self._held_for = 0
        ends = self._is_cut or (lasted and self._env.success)
        try:
            self._last_seen = self._seen()
        except EmptyCloudError:  # what stood before the cameras has left the workspace: nothing to go on from
            ends = True
            if not settles:
                at_rest = self._settle(action)
        env = self._env
        success = bool(ends and at_rest and env.success and env.is_finite and is_stable(env.measure()))
        cut = self._is_cut and not success
        return self._last_seen, float(success), ends and not cut, cut, {"is_success": success}

    @property
    def _is_cut(self) -> bool:
        """Whether the step limit is reached, less the time to settle."""
        return self._env.elapsed_steps >= self._max_episode_steps

    def _settle(self, action: npt.NDArray[np.float32]) -> bool:
        """Hold an action until the episode may be judged; return whether the scene is at rest."""
        env = self._env

        def hold() -> Measurement:
            env.step(action)
            return env.measure()

        return settle(hold, env.measure(), env.profile)

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
        seen: dict[str, Any] = dict(self._env.observe(self._spec))
        if self._spec.is_privileged:
            seen[ENVIRONMENT_STATE] = seen[CLOUD][:, :3].reshape(-1)
        return {name: np.asarray(seen[name], dtype=np.float32) for name in self.observation_space}

"""Configuration of environments: which tasks, which scenes, what is seen."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
from lerobot.configs import FeatureType, PolicyFeature
from lerobot.envs import EnvConfig
from lerobot.utils.constants import ACTION, OBS_ENV_STATE, OBS_STATE, OBS_STR

from gensim2.perception import ObservationSpec
from gensim2.perception.observation import CLOUD, ENVIRONMENT_STATE, GRIPPER, STATE, TOOL_POSE, VELOCITY
from gensim2.robots import robot
from lerobot_env_gensim2.environment import GenSim2Gym


@EnvConfig.register_subclass("gensim2")
@dataclass
class GenSim2EnvConfig(EnvConfig):
    """Tasks on random scenes, by ``--env.type=gensim2``.

    Attributes:
        task: names with commas between them.
        checkpoint: a policy's folder: what is seen is what it was trained on. Empty: clouds of ``points``.
        points: of a cloud, where there is no checkpoint.
        source: the same: ``"depth"``, or ``"keypoints"``: the cloud is made of what only a simulator knows, and is the
            state of the environment, for privileged baselines (``gensim2 render --source keypoints``).
        assets, instances, physics, randomization, robot: as of ``gensim2 evaluate``.
    """

    task: str | None = "CloseBox"
    fps: int = 20
    checkpoint: str = ""
    points: int = 1024
    source: str = "depth"
    assets: str = "builtin"
    instances: str = "test"
    physics: str = "default"
    randomization: str = "paper"
    robot: str = "panda"
    features: dict[str, PolicyFeature] = field(default_factory=dict)
    features_map: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        profile = robot(self.robot)
        self.fps = round(profile.control_hz)
        n, points = len(profile.reset_qpos), self.spec.cloud.points
        shapes = {STATE: (n,), VELOCITY: (n,), TOOL_POSE: (7,), GRIPPER: (2,), CLOUD: (points, 6)}
        for name, shape in shapes.items():
            self.features[name] = PolicyFeature(type=FeatureType.STATE, shape=shape)
            self.features_map[name] = OBS_STATE if name == STATE else f"{OBS_STR}.{name}"
        if self.spec.is_privileged:
            self.features[ENVIRONMENT_STATE] = PolicyFeature(type=FeatureType.ENV, shape=(3 * points,))
            self.features_map[ENVIRONMENT_STATE] = OBS_ENV_STATE
        self.features[ACTION] = PolicyFeature(type=FeatureType.ACTION, shape=(profile.arm_size + 1,))
        self.features_map[ACTION] = ACTION

    @property
    def spec(self) -> ObservationSpec:
        """Observations: those of the checkpoint, or clouds of ``points`` by ``source``."""
        if not self.checkpoint:
            settings = {"points": self.points, "candidates": 4 * self.points, "source": self.source}
            return ObservationSpec.of(settings)
        written = json.loads((Path(self.checkpoint) / "config.json").read_text())
        return ObservationSpec.of(written["observation"])

    @property
    def gym_kwargs(self) -> dict[str, Any]:
        """Keywords of an environment, beside its task."""
        words = ("assets", "instances", "physics", "randomization", "robot")
        return {"spec": self.spec, "scene": {name: getattr(self, name) for name in words}}

    def create_envs(
        self, n_envs: int, use_async_envs: bool = False
    ) -> dict[str, dict[int, gym.vector.VectorEnv[Any, Any, Any]]]:
        """Return a vector of ``n_envs`` environments for each task, by its number."""
        several = use_async_envs and n_envs > 1
        kind = partial(gym.vector.AsyncVectorEnv, context="forkserver") if several else gym.vector.SyncVectorEnv
        return {
            "gensim2": {
                number: kind(
                    [partial(GenSim2Gym, name.strip(), **self.gym_kwargs)] * n_envs,
                    autoreset_mode=gym.vector.AutoresetMode.SAME_STEP,
                )
                for number, name in enumerate((self.task or "").split(","))
            }
        }

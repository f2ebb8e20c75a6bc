"""What an environment lets a policy see: ManiSkill's observations, with where the objects stand, or ray-cast points."""

from __future__ import annotations

from typing import Any

import torch
from mani_skill.envs.sapien_env import BaseEnv

from gensim2.raycast.sensor import OBS_MODE as RAYCAST
from gensim2.raycast.sensor import RaycastSensor
from gensim2.robots import RobotProfile
from gensim2.sim.scene_access import SceneAccessMixin


class RaycastObservations(SceneAccessMixin, BaseEnv):  # type: ignore[misc]
    """Adds ``obs_mode="raycast"`` to ManiSkill's; ``_sensor`` is None in all others."""

    profile: RobotProfile
    _sensor: RaycastSensor | None

    def _get_obs_extra(self, info: dict[str, Any]) -> dict[str, Any]:
        """Hand pose in the world; with state observations also where the objects and their links stand."""
        extra: dict[str, Any] = {"tcp_pose": self.agent.robot.links_map[self.profile.tool_link].pose.raw_pose}
        if self.obs_mode_struct.use_state:
            extra["objects"] = {
                name: {what: torch.from_numpy(row[None]) for what, row in part.observed().items()}
                for name, part in self.parts.items()
            }
        return extra

    @property
    def obs_mode(self) -> str:
        """What observations are of."""
        return str(super().obs_mode) if self._sensor is None else RAYCAST

    def get_obs(self, info: dict[str, Any] | None = None, unflattened: bool = False) -> Any:
        """As in ManiSkill; of ``"raycast"`` a dict of ``agent``, ``extra`` and ``pointcloud``."""
        if self._sensor is None:
            return super().get_obs(info, unflattened)
        return {
            "agent": self._get_obs_agent(),
            "extra": self._get_obs_extra(info or {}),
            "pointcloud": self._sensor.observe(self.get_state_dict(), int(self.elapsed_steps[0])),
        }

"""Compute ManiSkill's observations with object poses, or observations of this package by ray casting."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from mani_skill.envs.sapien_env import BaseEnv

from gensim2.perception import Observation, ObservationSpec
from gensim2.perception.observation import TOOL_POSE, tool_pose
from gensim2.perception.raycast.observer import Observer
from gensim2.robots import OPEN, RobotProfile
from gensim2.sim.scene_state import SceneAccessMixin
from gensim2.tasks.spec import TaskSpec

RAYCAST = "raycast"
"""Observation mode that returns an :class:`~gensim2.perception.Observation` without a renderer."""


class RaycastObservations(SceneAccessMixin, BaseEnv):  # type: ignore[misc]
    """Mixin for ``obs_mode="raycast"``. ``_seen`` is the observation spec in this mode and None in other modes."""

    profile: RobotProfile
    task: TaskSpec
    _seen: ObservationSpec | None
    _observer: Observer
    _command = OPEN

    def _prepare_observations(self, seed: int) -> None:
        """Create the ray-cast observer of a new scene, and reset the gripper command."""
        self._command = OPEN
        if self._seen is not None:
            models = {name: thing.model for name, thing in self.initial_state.objects.items()}
            self._observer = Observer(self.profile, models, self._seen, seed, self.task.description)

    def _note_command(self, action: Any) -> None:
        """Store the gripper command, the last number of an action; None means no command."""
        if action is not None:
            values = action["action"] if isinstance(action, Mapping) else action
            self._command = float(values.reshape(-1)[-1])

    def _get_obs_extra(self, info: dict[str, Any]) -> dict[str, Any]:
        """Return the tool pose in the base frame and, for state observations, the poses of objects and their links."""
        joints = self.agent.robot.get_qpos()[0].cpu().numpy()
        extra: dict[str, Any] = {TOOL_POSE: torch.from_numpy(tool_pose(self.profile, joints)[None])}
        if self.obs_mode_struct.use_state:
            extra["objects"] = {
                name: {what: torch.from_numpy(row[None]) for what, row in part.observed().items()}
                for name, part in self.parts.items()
            }
        return extra

    @property
    def obs_mode(self) -> str:
        return str(super().obs_mode) if self._seen is None else RAYCAST

    def observe(self) -> Observation:
        """Return the observation of this instant, for ``obs_mode="raycast"``."""
        rows = {
            kind: {name: row.cpu().numpy() for name, row in group.items()}
            for kind, group in self.get_state_dict().items()
        }
        return self._observer.observe(rows, int(self.elapsed_steps[0]), self._command)

    def get_obs(self, info: dict[str, Any] | None = None, unflattened: bool = False) -> Any:
        """Return ManiSkill's observation, or with ``"raycast"`` the arrays of :meth:`observe` with a batch axis."""
        if self._seen is None:
            return super().get_obs(info, unflattened)
        return {name: torch.from_numpy(np.ascontiguousarray(array)[None]) for name, array in self.observe().items()}

"""The observer as a sensor of the environment: ``obs_mode="raycast"``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch

from gensim2.errors import InputError
from gensim2.objects import ObjectModel
from gensim2.observations import CloudSettings
from gensim2.raycast.observer import Observer
from gensim2.robots import RobotProfile

OBS_MODE = "raycast"


class RaycastSensor:
    """Point clouds of an environment's states, without a renderer.

    Args:
        settings: of the point clouds, or their fields; None: the defaults.

    Raises:
        InputError: a setting cannot be so.
    """

    def __init__(self, settings: CloudSettings | Mapping[str, Any] | None) -> None:
        if not isinstance(settings, CloudSettings | Mapping | None):
            raise InputError(f"must be a mapping, is {settings!r}", field="observation")
        self.settings = settings if isinstance(settings, CloudSettings) else CloudSettings.of(settings or {})
        self._observer: Observer | None = None

    def prepare(self, profile: RobotProfile, objects: Mapping[str, ObjectModel], seed: int) -> None:
        """Take note of a new scene.

        Raises:
            InputError: a file of the robot or of an object cannot be used.
            MissingExtraError: Embree is not installed.
        """
        self._observer = Observer(profile, objects, self.settings, seed)

    def observe(self, state: Mapping[str, Mapping[str, torch.Tensor]], step: int) -> dict[str, torch.Tensor]:
        """``xyz`` (1, N, 3) m in the robot's base frame, ``rgb`` (1, N, 3), ``segmentation`` (1, N).

        Args:
            state: of the environment (``get_state_dict``).
            step: control steps since the reset.

        Raises:
            EmptyCloudError: the cameras see nothing of the workspace.
        """
        assert self._observer is not None, "the environment prepares its sensor when it loads a scene"
        rows = {kind: {name: row.cpu().numpy() for name, row in group.items()} for kind, group in state.items()}
        cloud = self._observer.cloud(self._observer.views(self._observer.poses(rows)[0], step))
        assert cloud.segmentation is not None
        found = {"xyz": cloud.xyz, "rgb": cloud.rgb, "segmentation": cloud.segmentation}
        return {name: torch.from_numpy(array)[None] for name, array in found.items()}

"""SAPIEN's pictures of recorded states, whatever engine simulated them: nothing is simulated again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.scenes.config import SceneConfig
from gensim2.sim.env import GenSim2Env

Images = dict[str, npt.NDArray[Any]]


class StatePictures:
    """Pictures by the environment's cameras. The scene is built again only where other objects stand in it.

    Args:
        config: of the scenes.
        textures: ``rgb``, ``depth`` and ``segmentation``, or some of them.

    Raises:
        InputError: no Vulkan driver works.
    """

    def __init__(self, config: SceneConfig, textures: Sequence[str] = ("rgb",)) -> None:
        self._textures = tuple(textures)
        self._env = GenSim2Env(replace(config, engine="sapien"), obs_mode="+".join(textures))
        self._shown: Mapping[str, str] | None = None

    def show(self, instances: Mapping[str, str], seed: int, options: Mapping[str, Any]) -> None:
        """Have these objects in the scene.

        Args:
            instances: id of each object's instance.
            seed, options: of a reset that has them.
        """
        if self._shown != instances:
            self._env.reset(seed=seed, options=dict(options))
            self._shown = dict(instances)

    def at(self, states: Mapping[str, Any], step: int) -> dict[str, Images]:
        """Pictures by camera and texture, as ManiSkill's observations have them: (H, W, 3) uint8, (H, W) int16 mm,
        (H, W) int16.

        Args:
            states: ManiSkill's ``env_states``.
            step: which of their rows.
        """
        self._env.show(states, step)
        found = self._env._get_obs_sensor_data()
        return {
            camera: {name: np.asarray(images[name][0].cpu().numpy()).squeeze() for name in self._textures}
            for camera, images in found.items()
        }

    def colors(self, states: Mapping[str, Any], row: int) -> dict[str, npt.NDArray[np.uint8]]:
        """Colour pictures (H, W, 3) by camera."""
        return {camera: images["rgb"] for camera, images in self.at(states, row).items()}

    def close(self) -> None:
        """End it."""
        self._env.close()

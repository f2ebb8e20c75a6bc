"""Render recorded states of any engine with SAPIEN, without simulation."""

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
    """Renderer of recorded states as the environment's cameras see them.

    Only new objects make the renderer rebuild the scene.

    Args:
        config: settings of the scenes.
        textures: which of ``rgb``, ``depth`` and ``segmentation`` to render.

    Raises:
        InputError: no Vulkan driver works.
    """

    def __init__(self, config: SceneConfig, textures: Sequence[str] = ("rgb",)) -> None:
        self._textures = tuple(textures)
        self._env = GenSim2Env(replace(config, engine="sapien"), obs_mode="+".join(textures))
        self._shown: Mapping[str, str] | None = None

    def show(self, instances: Mapping[str, str], seed: int, options: Mapping[str, Any]) -> None:
        """Build the scene with the given objects, unless the current scene has the same objects.

        Args:
            instances: mapping from each object of the task to the id of its instance.
            seed, options: arguments for the environment's ``reset``, which must choose the instances in ``instances``.
        """
        if self._shown != instances:
            self._env.reset(seed=seed, options=dict(options))
            self._shown = dict(instances)

    def at(self, states: Mapping[str, Any], step: int) -> dict[str, Images]:
        """Return the images of a recorded state: for each camera, a mapping from the texture name to the image. ``rgb``
        is (H, W, 3) uint8, ``depth`` is (H, W) int16 in mm, and ``segmentation`` is (H, W) int16.

        Args:
            states: ManiSkill's ``env_states``.
            step: index of the state in ``states``.
        """
        self._env.show(states, step)
        found = self._env._get_obs_sensor_data()
        return {
            camera: {name: np.asarray(images[name][0].cpu().numpy()).squeeze() for name in self._textures}
            for camera, images in found.items()
        }

    def colors(self, states: Mapping[str, Any], row: int) -> dict[str, npt.NDArray[np.uint8]]:
        """Return a colour image (H, W, 3) for each camera, by camera name.

        Args:
            states: ManiSkill's ``env_states``.
            row: index of the state in ``states``.
        """
        return {camera: images["rgb"] for camera, images in self.at(states, row).items()}

    def close(self) -> None:
        self._env.close()

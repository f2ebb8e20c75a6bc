"""What a policy sees of a recorded state: one function for data sets and for evaluation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.objects import ObjectModel
from gensim2.observations import Camera, CloudSettings, DepthNoise, PointCloud, View, point_cloud
from gensim2.raycast.scene import RaycastScene
from gensim2.robots import RobotProfile
from gensim2.seeding import rng
from gensim2.sim.cameras import observation_cameras

Array = npt.NDArray[np.float64]


class Observer:
    """Observations of one episode, each a function of the state, of the episode's seed and of the step alone.

    Args:
        profile: of the robot.
        objects: by name, in the task's order.
        settings: of the point clouds.
        seed: of the episode's reset; the noise follows from it.
        cameras: None takes the environment's three.

    Raises:
        InputError: a file of the robot or of an object cannot be used.
        MissingExtraError: Embree is not installed.
    """

    def __init__(
        self,
        profile: RobotProfile,
        objects: Mapping[str, ObjectModel],
        settings: CloudSettings,
        seed: int,
        cameras: Sequence[Camera] | None = None,
    ) -> None:
        self.settings, self._seed = settings, seed
        self.scene = RaycastScene(profile, objects, observation_cameras(profile) if cameras is None else cameras)

    def poses(self, states: Mapping[str, Any]) -> Array:
        """(T, L, 4, 4) of what is seen, from ManiSkill's ``env_states`` of T instants.

        Raises:
            InputError: they are not of this scene.
        """
        return self.scene.poses(states)

    def views(self, poses: Array, step: int) -> tuple[View, ...]:
        """The cameras' pictures, with the noise of the settings on them.

        Args:
            poses: (L, 4, 4), one row of :meth:`poses`.
            step: control steps since the reset.
        """
        views = self.scene.see(poses)
        noise = self.settings.noise
        if noise is None:
            return views
        generator = rng(self._seed, "depth noise", step)
        return tuple(_Noisy(view, noise, generator) for view in views)

    def cloud(self, views: Sequence[View]) -> PointCloud:
        """The point cloud of pictures.

        Raises:
            EmptyCloudError: the cameras see nothing that it keeps.
        """
        return point_cloud(views, self.settings, self.scene.robot)


class _Noisy:
    """A view with noise on its depth."""

    def __init__(self, view: View, noise: DepthNoise, generator: np.random.Generator) -> None:
        self.camera, self.segmentation, self.colors_at = view.camera, view.segmentation, view.colors_at
        self.depth = noise.on(view.depth, generator)

"""Draw pictures of recorded states, seen from the camera that also records the videos of episodes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array
from gensim2.objects import ObjectModel
from gensim2.perception.camera import Camera
from gensim2.perception.raycast.drawing import shaded
from gensim2.perception.raycast.scene import RaycastScene
from gensim2.robots import RobotProfile

VIDEO_EYE, VIDEO_TARGET = (-0.55, -1.3, 0.8), (-0.13, -0.07, 0.23)
"""Position and target (m in the world) of the camera for videos. From the right it sees the robot, the object's front,
neighbouring objects, and the inside behind most open doors, which have hinges on the left."""
VIDEO_WIDTH, VIDEO_HEIGHT = 640, 480
VIDEO_FIELD_OF_VIEW = float(np.deg2rad(50))


class StateDrawing:
    """Renders recorded states by ray casting, without a graphics driver. The camera has the same pose as the camera
    that records videos of episodes.

    Args:
        profile: robot profile.
        objects: objects by name, in the task's order.

    Raises:
        InputError: a file of the robot or of an object cannot be used.
    """

    def __init__(self, profile: RobotProfile, objects: Mapping[str, ObjectModel]) -> None:
        turn, base = profile.T_world_base[:3, :3].T, np.array(profile.base_position)
        eye, target = (turn @ (np.array(point) - base) for point in (VIDEO_EYE, VIDEO_TARGET))
        size = {"width": VIDEO_WIDTH, "height": VIDEO_HEIGHT}
        camera = Camera.looking("video", eye, target, fov=VIDEO_FIELD_OF_VIEW, **size)
        self._objects = objects
        self._scene = RaycastScene(profile, objects, (camera,))

    def of(self, state: Mapping[str, Any]) -> npt.NDArray[np.uint8]:
        """Draw the scene in one state.

        Args:
            state: ManiSkill's ``env_states`` with one row in each array.

        Returns:
            Image (H, W, 3).

        Raises:
            InputError: the state lacks an object of this scene, or an array has a wrong shape.
        """
        (view,) = self._scene.see(self._scene.poses(state)[0])
        return shaded(view)

    def close(self) -> None:
        """Release the renderer's memory."""

    def keypoints(self, states: Mapping[str, Any]) -> Array:
        """Return the positions (T, K, 3) of the K keypoints of all objects in the base frame, m.

        Args:
            states: ManiSkill's ``env_states``; each array has T rows.

        Raises:
            InputError: the states lack an object of this scene, or an array has a wrong shape.
        """
        found = []
        for name, model in self._objects.items():
            for keypoint in model.keypoints.values():
                link = name if model.joint is None else keypoint.link
                T = self._scene.link_poses(states, name, link)
                found.append(T[:, :3, :3] @ np.asarray(keypoint.position) + T[:, :3, 3])
        return np.stack(found, axis=1)

"""Draw pictures of recorded states by ray casting, without a graphics driver."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.objects import ObjectModel
from gensim2.perception.camera import Camera
from gensim2.perception.raycast.scene import RaycastScene
from gensim2.robots import RobotProfile

Array = npt.NDArray[np.float64]

VIDEO_EYE, VIDEO_TARGET = (-0.55, -1.3, 0.8), (-0.13, -0.07, 0.23)
"""Position and target (m in the world) of the camera for videos. From the right it sees the robot, the object's front,
neighbouring objects, and the inside behind most open doors, which have hinges on the left."""
VIDEO_WIDTH, VIDEO_HEIGHT = 640, 480
VIDEO_FIELD_OF_VIEW = float(np.deg2rad(50))

AMBIENT = np.float32(0.38)
LAMPS = (((0.5, -0.8, -1.3), 1.1), ((-0.6, 0.5, -1.0), 0.45))
"""Directions of the lights in the world, and their brightness."""
BACKGROUND = 244
"""Brightness of the background."""


class StateDrawing:
    """Renders recorded states from the camera position of videos.

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
        directions = np.array([turn @ direction for direction, _ in LAMPS])
        self._lamps = (-directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)
        self._strength = np.array([strength for _, strength in LAMPS], dtype=np.float32)

    def at(self, states: Mapping[str, Any], row: int) -> npt.NDArray[np.uint8]:
        """Return the picture (H, W, 3) of one recorded state.

        Args:
            states: ManiSkill's ``env_states``.
            row: index of the state in the arrays.

        Raises:
            InputError: the states are not of this scene.
        """
        one = {kind: {name: values[row : row + 1] for name, values in group.items()} for kind, group in states.items()}
        poses = self._scene.poses(one)[0]
        (view,) = self._scene.see(poses)
        colors = view.colors_at(np.arange(VIDEO_WIDTH * VIDEO_HEIGHT)).reshape(VIDEO_HEIGHT, VIDEO_WIDTH, 3)
        light = self._brightness(poses, view.camera.position)[view.face]
        picture: npt.NDArray[np.uint8] = np.minimum(colors * light[:, :, None], np.float32(255.0)).astype(np.uint8)
        picture[view.face < 0] = BACKGROUND
        return picture

    def _brightness(self, poses: Array, eye: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Return the brightness (F + 1,) of each triangle's side that faces ``eye``; the last entry is 1."""
        found = []
        for solid, pose in zip(self._scene.solids, poses.astype(np.float32), strict=True):
            turn, place = pose[:3, :3], pose[:3, 3]
            normals, away = solid.surface.normals, solid.surface.centers - (eye - place) @ turn
            towards = np.where((normals * away).sum(axis=1) > 0.0, np.float32(-1.0), np.float32(1.0))
            facing = towards[:, None] * (normals @ (turn.T @ self._lamps.T))
            found.append(AMBIENT + np.clip(facing, 0.0, None) @ self._strength)
        return np.concatenate([*found, np.ones(1, np.float32)])

    def keypoints(self, states: Mapping[str, Any]) -> Array:
        """Return the positions (T, K, 3) of the K keypoints of all objects in the base frame, m.

        Args:
            states: ManiSkill's ``env_states``; each array has T rows.

        Raises:
            InputError: the states are not of this scene.
        """
        found = []
        for name, model in self._objects.items():
            for keypoint in model.keypoints.values():
                link = name if model.joint is None else keypoint.link
                T = self._scene.link_poses(states, name, link)
                found.append(T[:, :3, :3] @ np.asarray(keypoint.position) + T[:, :3, 3])
        return np.stack(found, axis=1)

"""Set up cameras and lights of SAPIEN's renderer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import sapien
import torch
from mani_skill.envs.scene import ManiSkillScene
from mani_skill.sensors.camera import CameraConfig
from mani_skill.utils import sapien_utils

from gensim2.core.errors import InputError
from gensim2.perception.camera import FAR, FIELD_OF_VIEW, NEAR, PIXELS, PLACES, TARGET
from gensim2.perception.raycast.state_drawing import (
    VIDEO_EYE,
    VIDEO_FIELD_OF_VIEW,
    VIDEO_HEIGHT,
    VIDEO_TARGET,
    VIDEO_WIDTH,
)
from gensim2.robots import RobotProfile
from gensim2.sim.driver import NO_DRIVER, can_render

_T_OPENCV_SAPIEN = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]], dtype=np.float64)
"""Axes of SAPIEN's cameras (x forward, y left, z up) in OpenCV's camera frame, as columns."""

WITHOUT_RENDERER = "obs_mode 'raycast' (point clouds, depth, segmentation) or 'state', which need none"


def add_lights(scene: ManiSkillScene, shadows: bool) -> None:
    """Light the scene like a room, with ambient light and two lights from above.

    ``shadows`` is for the brighter one.
    """
    scene.set_ambient_light([0.38, 0.38, 0.4])
    scene.add_directional_light(
        [0.5, -0.8, -1.3], [1.1, 1.08, 1.0], shadow=shadows, shadow_scale=1.5, shadow_map_size=2048
    )
    scene.add_directional_light([-0.6, 0.5, -1.0], [0.45, 0.45, 0.5])


def observation_cameras(profile: RobotProfile, links: Mapping[str, Any]) -> list[CameraConfig]:
    """Return the configs with which SAPIEN renders the cameras that :mod:`gensim2.perception.camera` defines.

    Args:
        profile: profile of the robot; it may define cameras that are mounted on links.
        links: links of the robot by name.
    """
    fixed = [
        CameraConfig(name, sapien_utils.look_at(place, TARGET), PIXELS, PIXELS, fov=FIELD_OF_VIEW, near=NEAR, far=FAR)
        for name, place in PLACES.items()
    ]
    carried = [
        CameraConfig(
            camera.name,
            sapien.Pose(np.asarray(camera.T_link_camera) @ _T_OPENCV_SAPIEN),
            camera.width,
            camera.height,
            fov=camera.field_of_view,
            near=NEAR,
            far=FAR,
            mount=links[camera.link],
        )
        for camera in profile.cameras
    ]
    return fixed + carried


def video_camera() -> CameraConfig:
    """Return the camera for videos."""
    pose = sapien_utils.look_at(VIDEO_EYE, VIDEO_TARGET)
    size = (VIDEO_WIDTH, VIDEO_HEIGHT)
    return CameraConfig("render_camera", pose, *size, fov=VIDEO_FIELD_OF_VIEW, near=0.01, far=20, shader_pack="default")


def backend(asked: str, obs_mode: str | None, render_mode: str | None) -> str:
    """Return ManiSkill's ``render_backend``.

    ``"auto"`` becomes ``"gpu"`` or ``"cpu"`` if pictures are needed and a driver works, else ``"none"``. Other values
    are not changed.

    Raises:
        InputError: observations need images, and there is no renderer.
    """
    needs_pictures = obs_mode not in (None, "none", "state", "state_dict")
    if asked == "none":
        if needs_pictures:
            wrong = f"obs_mode {obs_mode!r} needs rendering"
            raise InputError(wrong, field="render_backend", remedy=f"use {WITHOUT_RENDERER}")
        return "none"
    if asked != "auto":
        return asked
    if needs_pictures and not can_render():
        raise InputError(NO_DRIVER, field="obs_mode", remedy=f"use {WITHOUT_RENDERER}")
    if not (needs_pictures or render_mode is not None) or not can_render():
        # Without a driver, an environment with a render mode can still simulate; only render() raises an error.
        return "none"
    return "gpu" if torch.cuda.is_available() else "cpu"

"""Observations of a policy: the same code for a simulated camera and a real one, in training and in evaluation.

Depth pictures of several cameras become one point cloud in the robot's base frame, cropped to the workspace, with the
robot's own gripper in it, sampled to a set size; beside it stand the robot's joints, its tool pose, its gripper and the
sentence. An :class:`ObservationSpec` says what is seen, an :class:`Encoder` makes :class:`Observation` of it. Nothing
here knows a simulator.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from gensim2.core.lazy import lazy_names

if TYPE_CHECKING:
    from gensim2.perception.camera import Camera, Picture, View
    from gensim2.perception.cloud import CloudSettings, EmptyCloudError, PointCloud, RobotSegments, point_cloud
    from gensim2.perception.noise import D435, DEPLOYED, CameraError, DepthNoise
    from gensim2.perception.observation import Encoder, Observation, ObservationSpec

__all__ = [
    "D435",
    "DEPLOYED",
    "Camera",
    "CameraError",
    "CloudSettings",
    "DepthNoise",
    "EmptyCloudError",
    "Encoder",
    "Observation",
    "ObservationSpec",
    "Picture",
    "PointCloud",
    "RobotSegments",
    "View",
    "point_cloud",
]

__getattr__ = lazy_names(__name__)

"""Compute observations of a policy, with the same code for simulated and real cameras.

Depth images of several cameras are fused into one point cloud in the robot's base frame. The cloud is cropped to the
workspace, includes the robot's gripper, and is sampled to a fixed size. An observation also has the robot's joint
positions, tool pose and gripper state, and the instruction. An :class:`ObservationSpec` selects the contents, and an
:class:`Encoder` computes an :class:`Observation`. This package does not depend on a simulator.
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

"""What a policy sees, made of depth pictures: the same code for a simulated camera and a real one.

Depth pictures of several cameras become one point cloud in the robot's base frame, cropped to the workspace, with the
robot's own gripper in it, sampled to a set size. Nothing here knows a simulator.
"""

from __future__ import annotations

from gensim2.observations.camera import Camera
from gensim2.observations.cloud import CloudSettings, EmptyCloudError, PointCloud, Robot, point_cloud
from gensim2.observations.noise import DepthNoise
from gensim2.observations.view import Picture, View

__all__ = [
    "Camera",
    "CloudSettings",
    "DepthNoise",
    "EmptyCloudError",
    "Picture",
    "PointCloud",
    "Robot",
    "View",
    "point_cloud",
]

"""Robot profiles: the data that planning, control and simulation need about each robot."""

from gensim2.robots.description import mounted, read_description, stored, touching_neighbours
from gensim2.robots.gripper import CLOSED, OPEN, Gripper, Mimic, SlidingGripper
from gensim2.robots.maniskill import robot_folder
from gensim2.robots.profile import (
    DEFAULT_ROBOT,
    Footprint,
    JointDrive,
    JointLimits,
    MountedCamera,
    RobotFiles,
    RobotProfile,
    Simulation,
    finger_keypoints,
)
from gensim2.robots.registry import load_robot, register_robot, robot, robot_key, robot_names

__all__ = [
    "CLOSED",
    "DEFAULT_ROBOT",
    "OPEN",
    "Footprint",
    "Gripper",
    "JointDrive",
    "JointLimits",
    "Mimic",
    "MountedCamera",
    "RobotFiles",
    "RobotProfile",
    "Simulation",
    "SlidingGripper",
    "finger_keypoints",
    "load_robot",
    "mounted",
    "read_description",
    "register_robot",
    "robot",
    "robot_folder",
    "robot_key",
    "robot_names",
    "stored",
    "touching_neighbours",
]

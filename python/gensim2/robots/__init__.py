"""Robots: one profile each, with all that planning, control and simulation need to know of it."""

from gensim2.robots.profile import (
    CLOSED,
    DEFAULT_ROBOT,
    OPEN,
    Gripper,
    RobotFiles,
    RobotProfile,
    Workspace,
    robot,
    robot_names,
)

__all__ = [
    "CLOSED",
    "DEFAULT_ROBOT",
    "OPEN",
    "Gripper",
    "RobotFiles",
    "RobotProfile",
    "Workspace",
    "robot",
    "robot_names",
]

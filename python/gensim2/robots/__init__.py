"""Robots: one profile each, with all that planning, control and simulation need to know of it."""

from gensim2.robots.profile import Gripper, RobotProfile, robot, robot_names

__all__ = ["Gripper", "RobotProfile", "robot", "robot_names"]

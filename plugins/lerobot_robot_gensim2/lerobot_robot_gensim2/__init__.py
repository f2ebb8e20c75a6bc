"""Arms of gensim2 for LeRobot, which finds this package by its name."""

from lerobot_robot_gensim2.config_gensim2 import GenSim2RobotConfig
from lerobot_robot_gensim2.gensim2_robot import GenSim2Robot

__all__ = ["GenSim2Robot", "GenSim2RobotConfig"]

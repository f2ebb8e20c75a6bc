"""Tasks of gensim2 for LeRobot, which finds this package by its name."""

from lerobot_env_gensim2.configuration_gensim2 import GenSim2EnvConfig

__all__ = ["GenSim2EnvConfig"]

"""Policies of gensim2 for LeRobot, which finds this package by its name."""

from lerobot_policy_gensim2.configuration_gensim2 import GenSim2Config

__all__ = ["GenSim2Config"]

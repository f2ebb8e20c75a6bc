"""ManiSkill environments, one a task.

Importing this module registers them with gymnasium, without importing ManiSkill:

    import gymnasium as gym
    import gensim2.sim
    env = gym.make("GenSim2-OpenDrawer-v1")

A program that does not import gensim2 by itself names the module in the id,
``gensim2.sim:GenSim2-OpenDrawer-v1``; recorded trajectories carry that id, so that ManiSkill's own tools can
replay them.
"""

from gensim2.sim.registration import TASK_ENV_ID, env_id, register_all

__all__ = ["TASK_ENV_ID", "env_id", "register_all"]

register_all()

"""Register the ids of all task environments with Gymnasium on import, without importing a simulator.

import gymnasium as gym
import gensim2.envs
env = gym.make("GenSim2-OpenDrawer-v1")
"""

from __future__ import annotations

from gensim2.sim.registration import TASK_ENV_ID, env_id, make_env, make_vec_env, register_all

__all__ = ["TASK_ENV_ID", "env_id", "make_env", "make_vec_env", "register_all"]

register_all()

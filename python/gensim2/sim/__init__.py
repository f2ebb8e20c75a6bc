"""Provide a ManiSkill environment for each task.

Importing this module registers the environments with gymnasium, without importing ManiSkill:

    import gymnasium as gym
    import gensim2.sim

    env = gym.make("GenSim2-OpenDrawer-v1")

The id ``gensim2.sim:GenSim2-OpenDrawer-v1`` works without this import, because gymnasium imports the module that is
named before the colon. Recorded trajectories contain ids of this form, so that ManiSkill's tools can replay them.

The class ``HeadlessEnv`` simulates only the physics. It reaches exactly the same states as the ManiSkill environment.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

from gensim2.core.lazy import lazy_names
from gensim2.sim.registration import TASK_ENV_ID, env_id, make_env, make_vec_env, register_all

if TYPE_CHECKING:
    from gensim2.sim.env import GenSim2Env
    from gensim2.sim.headless import HeadlessEnv

__all__ = ["TASK_ENV_ID", "GenSim2Env", "HeadlessEnv", "env_id", "make_env", "make_vec_env", "register_all"]

__getattr__ = lazy_names(__name__)

# ManiSkill's progress bars for notebooks, which are not used here, warn if ipywidgets is missing.
warnings.filterwarnings("ignore", message="IProgress not found")

register_all()

"""Train and run policies that map an instruction, a point cloud and the robot's state to actions.

A :class:`PolicyConfig` selects the encoders, trunk and head of a network. :func:`train` trains the network on data sets
and writes a :class:`PolicyCheckpoint`. A :class:`PolicyController` runs the checkpoint in a rollout.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from gensim2.core.lazy import lazy_names

if TYPE_CHECKING:
    from gensim2.policy.checkpoint import PolicyCheckpoint
    from gensim2.policy.config import PolicyConfig, TrainConfig
    from gensim2.policy.controller import PolicyController
    from gensim2.policy.remote.client import RemoteController
    from gensim2.policy.training import train

__all__ = ["PolicyCheckpoint", "PolicyConfig", "PolicyController", "RemoteController", "TrainConfig", "train"]

__getattr__ = lazy_names(__name__)

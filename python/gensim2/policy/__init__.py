"""Policies that map a sentence, a point cloud and the robot's state to motion (docs/guides/chunk_policies.md).

A :class:`PolicyConfig` says which encoders, trunk and head; :func:`train` learns from data sets; a
:class:`PolicyCheckpoint` is a folder; a :class:`PolicyController` acts in the loop that runs every controller.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from gensim2.core.lazy import lazy_names

if TYPE_CHECKING:
    from gensim2.policy.checkpoint import PolicyCheckpoint
    from gensim2.policy.config import PolicyConfig, TrainConfig
    from gensim2.policy.controller import PolicyController
    from gensim2.policy.training import train

__all__ = ["PolicyCheckpoint", "PolicyConfig", "PolicyController", "TrainConfig", "train"]

__getattr__ = lazy_names(__name__)

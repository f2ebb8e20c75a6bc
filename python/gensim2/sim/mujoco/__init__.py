"""Simulate scenes with MuJoCo, without importing SAPIEN, ManiSkill or PyTorch."""

from __future__ import annotations

from gensim2.core.errors import MissingExtraError

try:
    import mujoco  # noqa: F401
except ImportError as error:
    raise MissingExtraError("mujoco", "mujoco") from error

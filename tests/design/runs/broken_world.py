"""A fake world with a bug: the episode of the seed in ``BROKEN_SEED`` raises an error."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import fake_world

from gensim2.rollout.config import EpisodeConfig
from gensim2.tasks.strategies import Strategies


def record(config: EpisodeConfig, strategies: Strategies, seed: int, keep: Callable[..., Any]) -> Any:
    if os.environ.get("BROKEN_SEED") == str(seed):
        raise RuntimeError("broken on purpose")
    return fake_world.record(config, strategies, seed, keep)

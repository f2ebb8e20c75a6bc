"""A made-up world with a bug in it: the episode of the seed in ``BROKEN_SEED`` cannot be run."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import fake_world


def demonstrate(setting: Any, config: Mapping[str, Any], seed: int) -> Any:
    if os.environ.get("BROKEN_SEED") == str(seed):
        raise RuntimeError("broken on purpose")
    return fake_world.demonstrate(setting, config, seed)

"""A made-up world in place of the simulator: what an episode gives follows from its seed, in a few milliseconds.

It stands in where runs are tested and physics is not the point. Its functions have the names and the results of those
in ``gensim2.pipeline.worker``, and run in worker processes as they do.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gensim2 import seeding
from gensim2.demos.recording import Recording
from gensim2.objects import open_library
from gensim2.pipeline import worker
from gensim2.pipeline.records import Attempt
from gensim2.tasks.spec import TaskSpec

EPISODE_SECONDS = 0.2


def install() -> None:
    """Let this process's runs happen in the made-up world."""
    worker.PRELOAD = ("gensim2.pipeline.worker", "gensim2.demos.recording")
    worker.screen_scene = screen_scene
    worker.attempt = attempt
    worker.demonstrate = demonstrate


def screen_scene(
    setting: worker.Setting, seed: int, configs: Sequence[Mapping[str, Any]]
) -> list[tuple[float, str | None]]:
    time.sleep(EPISODE_SECONDS)
    draws = seeding.rng(seed, "screen").random(len(configs))
    return [(1.0, None) if draw < 0.3 else (0.0, "unreachable") for draw in draws]


def attempt(setting: worker.Setting, config: Mapping[str, Any], seed: int) -> Attempt:
    return demonstrate(setting, config, seed)[0]


def demonstrate(setting: worker.Setting, config: Mapping[str, Any], seed: int) -> tuple[Attempt, Recording | None]:
    time.sleep(EPISODE_SECONDS)
    random = seeding.rng(seed, "episode")
    task = TaskSpec.model_validate_json(setting.task)
    library = open_library(setting.assets)
    ids = library.choose(task.asset_class, setting.instances)
    instance = library.load(task.asset_class, ids[int(random.integers(len(ids)))])
    success, start, end = bool(random.random() < 0.75), float(random.random()), float(random.random())
    found = Attempt(
        seed=seed,
        instance=instance.id,
        content_hash=instance.content_hash,
        success=success,
        still_success=False if success else None,
        openness_start=start,
        openness_end=end,
        steps=5,
        cause=None if success else "the object did not move",
        plan_status="solved",
        plan_reason="",
    )
    return found, recording(seed, instance.id, random) if success else None


def recording(seed: int, instance: str, random: np.random.Generator, steps: int = 5) -> Recording:
    """An episode of noise."""

    def noise(*shape: int) -> Any:
        return random.random(shape, dtype=np.float32)

    return Recording(
        seed=seed,
        reset_options={"instance": instance},
        control_mode="pd_joint_pos",
        actions=noise(steps, 8),
        obs=noise(steps + 1, 4),
        env_states={"articulations": {"object": noise(steps + 1, 15)}},
        rewards=noise(steps),
        terminated=np.zeros(steps, bool),
        truncated=np.zeros(steps, bool),
        success=np.ones(steps, bool),
        openness=noise(steps + 1),
    )

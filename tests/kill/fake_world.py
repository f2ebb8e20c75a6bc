"""A fake world instead of the simulator: the result of an episode depends on its seed and takes milliseconds.

It is used where runs are tested and physics does not matter. Its functions have the names and results of those in
``gensim2.rollout.worker``, and run in worker processes in the same way.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from gensim2.core import seeding
from gensim2.objects import open_library
from gensim2.rollout import worker
from gensim2.rollout.checker_result import Mutation, WorldCount
from gensim2.rollout.config import EpisodeConfig
from gensim2.rollout.record import Cause, Episode, ObjectRecord, PlanRecord, StepRecord, StrictMiss
from gensim2.rollout.recording import Recording
from gensim2.scenes.config import SceneOptions
from gensim2.scenes.physics import ENGINES
from gensim2.tasks.spec import TaskSpec
from gensim2.tasks.strategies import StepStrategies, Strategies

EPISODE_SECONDS = float(os.environ.get("FAKE_EPISODE_SECONDS", "0.2"))


#: Names in `gensim2.rollout.worker` that `install` replaces.
REPLACED = ("PRELOAD", "prepare", "judge_scene", "screen_scene", "episode", "trial", "demonstrate", "record")


def install() -> None:
    """Use the fake world for the runs of this process."""
    worker.PRELOAD = dict.fromkeys(ENGINES, ("gensim2.rollout.worker", "gensim2.rollout.recording"))
    worker.prepare = prepare
    worker.judge_scene = judge_scene
    worker.screen_scene = screen_scene
    worker.episode = episode
    worker.trial = trial
    worker.demonstrate = demonstrate
    worker.record = record


def prepare(scenes: Sequence[SceneOptions]) -> None:
    """Do nothing: a fake world needs no preparation."""


def judge_scene(config: EpisodeConfig, seed: int) -> list[WorldCount]:
    """Return an honest check: the goal does not hold in the no-op baseline."""
    return [WorldCount(None, str(Mutation.NOTHING), "", tuple(c.type for c in config.task.success), 1, 0)]


def screen_scene(config: EpisodeConfig, seed: int, candidates: Sequence[StepStrategies]) -> list[worker.Screened]:
    time.sleep(EPISODE_SECONDS)
    draws = seeding.rng(seed, "screen").random(len(candidates))
    return [(1.0, None, {}) if draw < 0.3 else (0.0, "unreachable", {}) for draw in draws]


def episode(config: EpisodeConfig, strategies: Strategies, seed: int) -> Episode:
    return demonstrate(config, strategies, seed)[0]


def trial(config: EpisodeConfig, ways: StepStrategies, seed: int) -> Episode:
    return demonstrate(config, {}, seed)[0]


def demonstrate(config: EpisodeConfig, strategies: Strategies, seed: int) -> tuple[Episode, Recording | None]:
    found, kept = _recorded(config, seed)
    return found, kept if found.held else None


def _recorded(config: EpisodeConfig, seed: int) -> tuple[Episode, Recording]:
    time.sleep(EPISODE_SECONDS)
    random = seeding.rng(seed, "episode")
    (name, thing), *rest = config.task.objects.items()
    library = open_library(config.scene.assets)
    drawn = (
        dict(config.scene.instances)[name] if isinstance(config.scene.instances, frozenset) else config.scene.instances
    )
    words = (drawn,) if isinstance(drawn, str) else drawn
    listed = [each for word in words for each in library.choose(thing.asset_class, word)]
    model = library.load(thing.asset_class, listed[int(random.integers(len(listed)))])
    held, start, end = bool(random.random() < 0.75), float(random.random()), float(random.random())
    others = {role: library.load(each.asset_class, library.instances(each.asset_class)[0]) for role, each in rest}
    found = episode_of(
        config.task,
        seed,
        held=held,
        instance=model.id,
        content_hash=model.content_hash,
        start=start,
        end=end,
        others={role: (other.id, other.content_hash) for role, other in others.items()},
    )
    ids = {name: model.id, **{role: other.id for role, other in others.items()}}
    return found, recording(seed, ids, random)


def record(config: EpisodeConfig, strategies: Strategies, seed: int, keep: Callable[..., Any]) -> Any:
    # In this process a test may have replaced the world; a worker process has the original functions there.
    if worker.demonstrate.__module__ not in (worker.__name__, __name__):
        return keep(*worker.demonstrate(config, strategies, seed))
    return keep(*_recorded(config, seed))


def episode_of(
    task: TaskSpec,
    seed: int,
    *,
    held: bool,
    cause: Cause = Cause.NO_CONTACT,
    instance: str = "0",
    content_hash: str = "ab12",
    start: float = 0.5,
    end: float | None = 0.9,
    others: Mapping[str, tuple[str, str]] = {},
) -> Episode:
    """Return a complete record of a fake episode.

    Args:
        instance, content_hash, start, end: of the first object.
        others: id and content hash of the other objects, by name.
    """
    first, *_ = task.objects
    chosen = {first: (instance, content_hash), **others}
    step = task.steps[0]
    plan = PlanRecord(strategy=step.strategies[0], status="solved", reason="", at_step=0, trigger="start", ran=5)
    return Episode(
        seed=seed,
        objects={
            name: ObjectRecord(
                asset_class=task.objects[name].asset_class,
                id=each,
                source="generated",
                content_hash=found,
                pose=[0.1, 0.0, 0.2, 1.0, 0.0, 0.0, 0.0],
                yaw=0.1,
                openness_start=start if name == first else None,
                openness_end=end if name == first else None,
            )
            for name, (each, found) in chosen.items()
        },
        placement_draws=1,
        steps=[StepRecord(name=step.name, plans=[plan], paper=held, done=held)],
        control_steps=5,
        paper=held,
        held=held,
        strict=held and seed % 2 == 0,
        strict_misses=[] if held and seed % 2 == 0 else [StrictMiss.NOT_LET_GO if held else StrictMiss.NOT_HELD],
        still=False if held else None,
        settled=True,
        truncated=False,
        cause=None if held else cause,
    )


def recording(seed: int, instances: dict[str, str], random: np.random.Generator, steps: int = 5) -> Recording:
    """Return a recording of random numbers."""

    def noise(*shape: int) -> Any:
        return random.random(shape, dtype=np.float32)

    return Recording(
        seed=seed,
        reset_options={"instance": instances},
        instances=instances,
        control_mode="pd_joint_pos",
        actions=noise(steps, 8),
        obs=noise(steps + 1, 4),
        env_states={"articulations": {"object": noise(steps + 1, 15), "panda": noise(steps + 1, 31)}},
        rewards=noise(steps),
        terminated=np.zeros(steps, bool),
        truncated=np.zeros(steps, bool),
        success=np.ones(steps, bool),
    )

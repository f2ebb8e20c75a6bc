"""The dense reward of recorded episodes: bounded, increasing towards success, and 1 exactly if the goal holds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import spearmanr

from gensim2.rollout.config import EpisodeConfig
from gensim2.rollout.worker import demonstrate
from gensim2.scenes.config import SceneOptions
from gensim2.sim.env import GenSim2Env
from gensim2.tasks import load_strategies, load_task


@pytest.mark.parametrize("name", ["OpenDrawer", "CloseBox", "PlaceGolfBallIntoDrawer"])
def test_it_rises_over_recorded_episodes(name: str) -> None:
    config = EpisodeConfig(SceneOptions("builtin").with_task(load_task(name)))
    _, recording = demonstrate(config, load_strategies(name), 0)
    assert recording is not None
    env = GenSim2Env(name, assets="builtin", reward_mode="normalized_dense")
    env.reset(seed=recording.seed, options=recording.reset_options)
    replayed = [env.step(action) for action in recording.actions]
    rewards = np.array([float(reward[0]) for _, reward, _, _, _ in replayed])
    success = np.array([bool(info["success"][0]) for *_, info in replayed])
    assert np.array_equal(success, recording.success)
    assert rewards.min() >= 0.0
    assert rewards.max() == 1.0
    assert np.array_equal(rewards == 1.0, success)
    assert spearmanr(np.arange(len(rewards)), rewards).statistic > 0.8
    assert len(np.unique(rewards)) > 0.3 * (~success).sum(), "a sparse one has two values"


def test_the_default_is_sparse() -> None:
    env = GenSim2Env("OpenDrawer", assets="builtin")
    assert env.reward_mode == "sparse"

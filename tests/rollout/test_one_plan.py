"""One plan per step: the paper's method with our solver, and its limits."""

from __future__ import annotations

import pytest

pytest.importorskip("mani_skill")

from gensim2.rollout import worker
from gensim2.rollout.config import EpisodeConfig, RolloutOptions
from gensim2.rollout.inputs import read_task_input
from gensim2.rollout.record import START


@pytest.mark.parametrize("name", ["OpenDrawer", "PlaceGolfBallIntoDrawer"])
def test_each_step_is_planned_once_by_its_first_strategy(name: str) -> None:
    given = read_task_input(name, assets="builtin")
    config = EpisodeConfig(given.scene, RolloutOptions(one_plan=True))
    begun, undone = 0, 0
    for seed in range(3):
        episode = worker.episode(config, given.strategies, seed)
        assert [step.name for step in episode.steps] == [step.name for step in given.spec.steps][: len(episode.steps)]
        for step, done in zip(given.spec.steps, episode.steps, strict=False):
            assert [(plan.strategy, plan.trigger) for plan in done.plans] == [(step.strategies[0], START)]
        begun = max(begun, len(episode.steps))
        undone += any(not step.done for step in episode.steps[:-1])
    assert begun == min(len(given.spec.steps), 3)
    assert undone or len(given.spec.steps) == 1, "a step that was not done ended the episode"

"""The hand leaves the objects after the last step."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gensim2.rollout import chain
from gensim2.rollout.chain import ChainController
from gensim2.rollout.record import StrictMiss
from gensim2.rollout.recording import EpisodeResult
from gensim2.rollout.run import run
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.library import load_strategies, load_task

SEEDS = range(4)


@pytest.fixture(scope="module")
def env() -> HeadlessEnv:
    return HeadlessEnv("CloseBox", assets="builtin")


def _episodes(env: HeadlessEnv, **given: Any) -> list[EpisodeResult]:
    """Run episodes in which the hand backs off by 1 cm only."""
    strategies = {name: {**config, "let_go": 0.01} for name, config in load_strategies("CloseBox").items()}
    controller = ChainController(load_task("CloseBox"), strategies, env.profile, **given)
    return [run(env, controller, seed=seed, record=False) for seed in SEEDS]


def test_a_hand_that_has_not_backed_off_goes_home(env: HeadlessEnv, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(chain, "planned_retreat", lambda *_: None)
        without = [result.episode for result in _episodes(env)]
    near = {StrictMiss.NOT_RETREATED, StrictMiss.NOT_LET_GO}
    assert all(episode.held for episode in without)
    assert all(near & set(episode.strict_misses) for episode in without)
    for result, before in zip(_episodes(env), without, strict=True):
        episode = result.episode
        assert episode.held
        assert not near & set(episode.strict_misses)
        assert before.control_steps < episode.control_steps <= before.control_steps + 120
        assert episode.steps[0].plans[0].reason == before.steps[0].plans[0].reason


def test_one_plan_a_step_is_followed_and_no_more(env: HeadlessEnv) -> None:
    for result in _episodes(env, one_plan=True):
        assert result.episode.control_steps < 140
        assert StrictMiss.NOT_RETREATED in result.episode.strict_misses


def test_a_hand_that_is_to_stay_stays() -> None:
    task = load_task("LiftBucketUpright")
    env = HeadlessEnv(task, assets="builtin", physics="original")
    config = load_strategies("LiftBucketUpright")["hold_from_the_side"]
    step = task.steps[0].model_copy(update={"strategies": ("hold_from_the_side",)})
    only = task.model_copy(update={"steps": (step,)})
    found = [
        run(env, ChainController(only, {"hold_from_the_side": config}, env.profile), seed=seed, record=False).episode
        for seed in SEEDS
    ]
    assert any(episode.held for episode in found)
    for episode in found:
        if episode.held:
            assert StrictMiss.NOT_LET_GO in episode.strict_misses
            assert np.isfinite(episode.control_steps)


def test_a_hand_whose_rest_posture_is_barred_backs_off(env: HeadlessEnv, monkeypatch: pytest.MonkeyPatch) -> None:
    """As if a door stood at the arm's rest pose: the planned motion ends in the obstacle."""
    planned = chain.planned_retreat

    def barred(world: Any, scene: Any, names: Any, near: bool, profile: Any) -> Any:
        below = np.array(profile.reset_qpos) + np.array([0.0, 1.2, *[0.0] * (len(profile.reset_qpos) - 2)])
        assert world.of(scene).in_collision(below)
        return planned(world, scene, names, near, replace(profile, reset_qpos=tuple(below)))

    with monkeypatch.context() as patch:
        patch.setattr(chain, "planned_retreat", lambda *_: None)
        without = [result.episode for result in _episodes(env)]
    monkeypatch.setattr(chain, "planned_retreat", barred)
    for result, before in zip(_episodes(env), without, strict=True):
        episode = result.episode
        assert episode.held
        assert StrictMiss.NOT_RETREATED not in episode.strict_misses
        assert before.control_steps < episode.control_steps

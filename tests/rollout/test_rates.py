"""Robots with other control rates are judged by the same seconds and speeds."""

from __future__ import annotations

from dataclasses import replace

import pytest
from scripted import OPEN_DRAWER, ScriptedController, ScriptedWorld, glide, instant

from gensim2.robots import robot
from gensim2.rollout.motion import MAX_SETTLE_SECONDS, SETTLE_SECONDS, is_at_rest
from gensim2.rollout.run import run


@pytest.mark.parametrize("rate", [10, 20, 50])
def test_an_episode_settles_and_ends_after_the_same_time(rate: int) -> None:
    profile = replace(robot("panda"), control_hz=rate)
    course = glide((0, {"openness": 0.0}), (rate, {"openness": 1.0}))
    episode = run(ScriptedWorld(OPEN_DRAWER, course, profile=profile), ScriptedController(rate), seed=0).episode
    assert episode.held
    assert episode.control_steps == rate + SETTLE_SECONDS * rate
    for_ever = ScriptedController(10**6)
    cut = run(ScriptedWorld(OPEN_DRAWER, course[:1], profile=profile), for_ever, seed=0).episode
    assert cut.truncated
    assert 0 <= cut.control_steps / rate - OPEN_DRAWER.max_episode_steps / 20 <= MAX_SETTLE_SECONDS


@pytest.mark.parametrize("rate", [10, 20, 50])
def test_rest_is_a_matter_of_speed(rate: int) -> None:
    for speed, rests in ((0.015, True), (0.025, False)):
        before, after = instant(openness=0.3), instant(openness=0.3 + speed / rate)
        assert is_at_rest(before, after, 1.0 / rate) is rests

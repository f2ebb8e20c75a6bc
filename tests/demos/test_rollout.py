"""What counts as a success, and what does not."""

from __future__ import annotations

import numpy as np
import pytest
from jobs import HALFWAY, hold, push

from gensim2.demos.rollout import SETTLE_STEPS, check_actions, run_episode, still_arm
from gensim2.errors import InputError
from gensim2.sim.env import GenSim2Env, make_env


@pytest.fixture(scope="module")
def env() -> GenSim2Env:
    return make_env(HALFWAY, assets="builtin", obs_mode="none")


def test_an_episode_is_judged_after_the_object_has_settled(env: GenSim2Env) -> None:
    env.reset(seed=0)
    actions = push(env.scene_state())
    result = run_episode(env, actions)
    assert result.success
    assert result.settled
    assert not result.truncated
    assert result.steps >= len(actions) + SETTLE_STEPS
    assert result.openness_end < 0.3 < result.openness_start
    assert result.openness_end == pytest.approx(env.openness)


def test_a_still_arm_fails_where_the_object_stays(env: GenSim2Env) -> None:
    result = still_arm(env, 0, 50)
    assert not result.success
    assert result.openness_end == pytest.approx(result.openness_start, abs=0.005)
    env.reset(seed=0)
    assert result.openness_start == env.openness


def test_an_object_that_moves_by_itself_shows_with_a_still_arm() -> None:
    """The lid of a box without friction falls shut: closing it would count for nothing."""
    import dataclasses

    from gensim2.assets import open_library
    from gensim2.assets.types import Instance

    library = open_library("builtin")

    class Slippery:
        def instances(self, asset_class: str, /) -> tuple[str, ...]:
            return library.instances(asset_class)[:1]

        def choose(self, asset_class: str, which: str, /) -> tuple[str, ...]:
            return self.instances(asset_class)

        def load(self, asset_class: str, instance_id: str, /) -> Instance:
            instance = library.load(asset_class, instance_id)
            return dataclasses.replace(instance, joint=dataclasses.replace(instance.joint, friction=1e-4, damping=0.0))

    slippery = make_env("CloseBox", assets=Slippery(), obs_mode="none")
    assert still_arm(slippery, 1).success
    normal = make_env("CloseBox", assets="builtin", instances=slippery.instance_ids, obs_mode="none")
    assert not still_arm(normal, 1).success


def test_a_passing_success_does_not_count(env: GenSim2Env) -> None:
    """The drawer is pushed far enough, then dragged out of the goal by hand: only the end is judged."""
    env.reset(seed=0)
    actions = push(env.scene_state())
    pushed = False

    original = env._after_control_step

    def drag_back() -> None:
        nonlocal pushed
        if int(env.elapsed_steps[0]) == len(actions) + 5:
            pushed = env.openness < 0.3
            joint = env._require_instance().joint
            env.object.set_qpos(np.array([[joint.lower + 0.9 * (joint.upper - joint.lower)]], dtype=np.float32))
        original()

    env._after_control_step = drag_back
    try:
        result = run_episode(env, actions)
    finally:
        del env._after_control_step
    assert pushed
    assert result.success_once
    assert not result.success


def test_an_episode_over_the_limit_is_truncated_and_fails(env: GenSim2Env) -> None:
    env.reset(seed=0)
    actions = push(env.scene_state())
    result = run_episode(env, np.concatenate([actions, np.repeat(actions[-1:], 70, axis=0)]))
    assert result.steps > env.max_episode_steps
    assert result.truncated
    assert result.success_once
    assert not result.success


def test_float64_actions_give_the_states_that_a_file_would_replay(env: GenSim2Env) -> None:
    env.reset(seed=2)
    actions = push(env.scene_state())
    double = run_episode(env, actions, seed=2)
    single = run_episode(env, actions.astype(np.float32), seed=2)
    assert double == single


@pytest.mark.parametrize(
    "actions",
    [np.zeros((0, 8)), np.zeros((5, 7)), np.zeros(8), np.full((3, 8), np.nan), np.full((3, 8), np.inf)],
)
def test_bad_actions_are_refused(actions: np.ndarray) -> None:
    with pytest.raises(InputError, match="actions: must be"):
        check_actions(actions)


def test_an_episode_begins_with_a_reset(env: GenSim2Env) -> None:
    run_episode(env, hold(), seed=0)
    with pytest.raises(InputError, match="already begun"):
        run_episode(env, hold())
    with pytest.raises(InputError, match="need a seed"):
        run_episode(env, hold(), options={"openness": 0.5})

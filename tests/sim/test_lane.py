"""The lane for episodes that nobody watches gives the states of the registered environment, bit for bit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gensim2.demos.rollout import still_arm
from gensim2.errors import GenSim2Error, InputError
from gensim2.pipeline.worker import plan_episode
from gensim2.robots import robot
from gensim2.sim.env import make_env
from gensim2.sim.lane import Lane
from gensim2.tasks.library import load_config, task_names
from gensim2.tasks.spec import TaskSpec

EPISODES = 104
HOLD = robot().rest_action


def _actions(lane: Lane, config: dict[str, Any], rng: np.random.Generator) -> np.ndarray:
    """What the task's plan says, shaken: a hand that pushes, slips, grasps and hits."""
    _, planned = plan_episode(lane, config)
    actions = np.repeat(HOLD[None], 30, axis=0) if planned is None else planned[:: int(rng.integers(2, 4))]
    noise = rng.normal(0.0, 0.03, actions.shape) * (rng.random() < 0.5)
    return np.asarray(np.clip(actions + noise, -2.8, 2.8), dtype=np.float32)


@pytest.mark.parametrize("name", task_names())
def test_states_and_observations_are_those_of_the_environment(name: str) -> None:
    env, lane = make_env(name, assets="builtin"), Lane(name, assets="builtin")
    config = load_config(name)
    rng = np.random.default_rng(len(name))
    for seed in range(EPISODES // len(task_names())):
        obs, _ = env.reset(seed=seed)
        lane.reset(seed)
        assert np.array_equal(obs[0].numpy(), lane.observation())
        for action in _actions(lane, config, rng):
            obs, reward, terminated, truncated, info = env.step(action)
            lane.step(action)
            assert np.array_equal(obs[0].numpy(), lane.observation())
            assert lane.success == bool(info["success"][0]) == bool(terminated[0]) == bool(reward[0])
        states = env.get_state_dict()["articulations"]
        for part, state in lane.state()["articulations"].items():
            assert np.array_equal(states[part][0].numpy(), state)
        assert lane.openness == env.openness
        assert lane.elapsed_steps == int(env.elapsed_steps[0])
        assert bool(truncated[0]) == (lane.elapsed_steps >= lane.max_episode_steps)


def test_reset_options_are_those_of_the_environment(crates: Callable[..., Any], crate_task: TaskSpec) -> None:
    library = crates(2, damping=0.05)
    env, lane = make_env(crate_task, assets=library), Lane(crate_task, assets=library)
    for options in (
        {"openness": 0.3, "offset": [0.02, -0.03, 0.2]},
        {"instance": library.instances("crate")[1]},
        {"pose": [0.05, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], "openness": 1.0},
    ):
        env.reset(seed=4, options=dict(options))
        lane.reset(4, options)
        for _ in range(10):
            env.step(HOLD)
            lane.step(HOLD)
        assert np.array_equal(env.get_obs()[0].numpy(), lane.observation())


def test_without_the_arm_an_object_does_what_it_does_beside_a_still_one(
    crates: Callable[..., Any], crate_task: TaskSpec
) -> None:
    for friction in (1e-4, 0.35):
        lane = Lane(crate_task, assets=crates(friction=friction))
        for seed in range(3):
            lane.reset(seed)
            for _ in range(100):
                lane.step(HOLD)
            alone = still_arm(lane, seed, 60)
            assert alone.success == (friction < 0.1)
            lane.reset(seed)
            for _ in range(100):
                lane.step(HOLD)
            assert lane.success == alone.success
            assert lane.openness == pytest.approx(alone.openness_end, abs=0.01)


def test_what_cannot_be_used_is_refused(crates: Callable[..., Any], crate_task: TaskSpec) -> None:
    lane = Lane(crate_task, assets=crates())
    with pytest.raises(GenSim2Error, match="not been reset"):
        lane.step(HOLD)
    with pytest.raises(InputError, match="seed"):
        lane.reset(-1)
    with pytest.raises(InputError, match="unknown reset option"):
        lane.reset(0, {"nonsense": 1})
    lane.reset(0)
    for action in (HOLD[:7], HOLD * np.nan):
        with pytest.raises(InputError, match="action: must be 8 finite numbers"):
            lane.step(action)
    lane.reset(0, robot=False)
    with pytest.raises(GenSim2Error, match="without the robot"):
        lane.step(HOLD)

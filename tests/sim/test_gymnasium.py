"""gymnasium's own checker passes, and unknown arguments of an environment are refused with one line."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import imageio.v2 as imageio
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env

import gensim2
import gensim2.sim  # registers the tasks
from gensim2.core.errors import ClosedEnvError, InputError
from gensim2.sim import rendering
from gensim2.sim.env import GenSim2Env
from gensim2.tasks.spec import TaskSpec

BOX = {"class": "box_rotate"}
ZERO = np.zeros(8, dtype=np.float32)


@pytest.fixture
def env(crates: Callable[..., Any], crate_task: TaskSpec) -> GenSim2Env:
    return GenSim2Env(crate_task, assets=crates())


@pytest.mark.parametrize("obs_mode", ["state", "state_dict", "raycast"])
def test_the_checker_of_gymnasium_passes(obs_mode: str) -> None:
    made = gensim2.make_env("OpenDrawer", numpy=True, assets="builtin", obs_mode=obs_mode)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # advice on spaces
        # Rendering does not depend on the observations: once is enough, and needs a Vulkan driver.
        check_env(made, skip_render_check=obs_mode != "state" or not rendering.can_render())
    made.close()
    made.close()


def test_values_are_the_batched_ones_without_their_batch() -> None:
    batched, plain = (gensim2.make_env("OpenDrawer", assets="builtin", numpy=numpy) for numpy in (False, True))
    before, _ = batched.reset(seed=3)
    obs, info = plain.reset(seed=3)
    assert np.array_equal(obs, before[0])
    assert obs.shape == plain.observation_space.shape
    expected = batched.step(ZERO)
    obs, reward, terminated, truncated, info = plain.step(ZERO)
    assert (reward, terminated, truncated) == (float(expected[1]), bool(expected[2]), bool(expected[3]))
    assert type(reward) is float
    assert type(terminated) is type(truncated) is bool
    assert info["openness"]["drawer"] == expected[4]["openness"]["drawer"][0]
    assert info["success"] is False
    assert type(info["elapsed_steps"]) is int
    assert type(info["openness"]["drawer"]) is float
    batched.close()
    plain.close()


def test_films_of_gymnasium_are_recorded(tmp_path: Path) -> None:
    pytest.importorskip("moviepy")
    if not rendering.can_render():
        pytest.skip("no Vulkan driver")
    env = gensim2.make_env("OpenDrawer", numpy=True, assets="builtin", render_mode="rgb_array", max_episode_steps=3)
    recorded = gym.wrappers.RecordVideo(env, str(tmp_path), episode_trigger=lambda episode: True)
    recorded.reset(seed=0)
    while not recorded.step(ZERO)[3]:
        pass
    recorded.close()
    (film,) = tmp_path.iterdir()
    frames = imageio.get_reader(film)
    assert frames.get_meta_data()["fps"] == 20
    assert frames.count_frames() == 4


def test_a_seed_seeds_the_generator_of_gymnasium(env: GenSim2Env) -> None:
    states = []
    for seed in (3, 4, 3):
        env.reset(seed=seed)
        assert env.np_random_seed == seed
        states.append(env.np_random.bit_generator.state)
    assert states[0] == states[2]
    assert states[0] != states[1]


@pytest.mark.parametrize(
    ("seed", "expected"),
    [
        ("a", "seed: must be a whole number, but is 'a'"),
        (1.5, "seed: must be a whole number"),
        (float("nan"), "seed: must be a whole number"),
        (True, "seed: must lie in 0"),
        ([1, 2], "seed: must be a single seed"),
        ([], "seed: must be a single seed"),
        (["a"], "seed: must be a whole number"),
        (2**1000, "a number of 1001 bits"),
    ],
)
def test_odd_seeds_are_named(env: GenSim2Env, seed: Any, expected: str) -> None:
    with pytest.raises(InputError) as caught:
        env.reset(seed=seed)
    assert expected in str(caught.value)


def test_seeds_of_numpy_and_lists_of_one_are_seeds(env: GenSim2Env) -> None:
    for seed in (np.int64(7), [7], np.array([7])):
        env.reset(seed=seed)  # type: ignore[arg-type]
        assert int(env._episode_seed[0]) == 7


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ([], "options: must be a mapping"),
        ("openness", "options: must be a mapping"),
        ({"offset": [1e308, 0, 0]}, "offset: the coordinates must lie between -10 m and 10 m"),
        ({"pose": [0, 0, 1e30, 1, 0, 0, 0]}, "pose: the coordinates must lie between -10 m and 10 m"),
        ({"env_idx": [3]}, "env_idx: must be 0, because a reset resets a single environment"),
        ({"reset_to_env_states": 5}, "reset_to_env_states: must be a mapping"),
    ],
)
def test_odd_reset_options_are_named(env: GenSim2Env, options: Any, expected: str) -> None:
    with pytest.raises(InputError) as caught:
        env.reset(seed=0, options=options)
    assert expected in str(caught.value)


@pytest.mark.parametrize(
    ("action", "expected"),
    [
        (np.full(8, np.inf), "action: must be finite"),
        (np.full(8, np.nan), "action: must be finite"),
        (torch.tensor([[float("inf")] * 8]), "action: must be finite"),
        (np.zeros(7), "action: must be 8 numbers, but has the shape (7,)"),
        (np.zeros((2, 8)), "action: must be 8 numbers, but has the shape (2, 8)"),
        ("up", "action: must be numbers"),
        ([1, [2]], "action: must be numbers"),
        ({"a": 1}, "action: a mapping must have the keys"),
        ({"control_mode": "fly", "action": ZERO}, "control_mode: must be one of"),
        ({"control_mode": "pd_joint_pos", "action": np.full(8, np.nan)}, "action: must be finite"),
    ],
)
def test_odd_actions_are_named_and_change_nothing(env: GenSim2Env, action: Any, expected: str) -> None:
    env.reset(seed=0)
    before = env.get_state().clone()
    with pytest.raises(InputError) as caught:
        env.step(action)
    assert expected in str(caught.value)
    assert torch.equal(before, env.get_state())
    assert int(env.elapsed_steps[0]) == 0


def test_actions_of_every_usual_kind_are_taken(env: GenSim2Env) -> None:
    env.reset(seed=0)
    for action in (ZERO, ZERO[None], ZERO.tolist(), torch.zeros(8), torch.zeros(1, 8), None):
        env.step(action)
    assert int(env.elapsed_steps[0]) == 6


@pytest.mark.parametrize(
    ("kwargs", "expected"),
    [
        ({"assets": 5}, "assets: must be None"),
        ({"assets": ""}, "no such folder"),
        ({"assets": "x" * 300}, "no such folder"),
        ({"task": 5}, "task: must be the name of a task"),
        ({"instances": 5}, "instances: must be text"),
        ({"instances": ""}, "instance: "),
        ({"instances": "random"}, "instances: 'random' is available only for runs"),
        ({"obs_mode": "smell"}, "obs_mode: no observation mode 'smell' (one of raycast, state"),
        ({"obs_mode": "rgb", "render_backend": "none"}, "use obs_mode 'raycast'"),
        ({"num_envs": 2}, "num_envs: must be 1, but is 2 (gensim2.make_vec_env"),
        ({"obs_mode": 5}, "obs_mode: must be text"),
        ({"control_mode": "fly"}, "fly not in supported modes"),
        ({"render_mode": "oil"}, "render_mode: must be one of"),
        ({"reward_mode": "dense"}, "reward_mode: must be one of sparse, normalized_dense, none"),
        ({"render_backend": "abacus"}, "render_backend: "),
    ],
)
def test_odd_arguments_are_named(kwargs: dict[str, Any], expected: str) -> None:
    with pytest.raises(InputError) as caught:
        GenSim2Env(**{"task": "OpenDrawer", "assets": "builtin", **kwargs})
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_spec_tells_the_step_limit_that_holds(crate_task: TaskSpec) -> None:
    fields = crate_task.model_copy(update={"max_episode_steps": 40}).model_dump(mode="json") | {"objects": {"box": BOX}}
    fields["steps"][0] |= {"object": "box", "done": [{"type": "articulated_closed", "object": "box"}]}
    for made, limit in (
        (gym.make("GenSim2-CloseBox-v1", assets="builtin"), 400),
        (gym.make("GenSim2-CloseBox-v1", assets="builtin", max_episode_steps=2), 2),
        (gensim2.make_env(fields, assets="builtin"), 40),
        (gensim2.make_env(fields, assets="builtin", max_episode_steps=2), 2),
    ):
        assert made.spec is not None
        assert made.spec.max_episode_steps == limit
        if limit == 2:
            made.reset(seed=0)
            truncated = [made.step(ZERO)[3] for _ in range(3)]
            assert [each.tolist() for each in truncated] == [[False], [True], [True]]
        made.close()


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_several_are_a_vector_environment_of_arrays(mode: str) -> None:
    several = gensim2.make_vec_env("CloseBox", 2, mode, assets="builtin", obs_mode="state")
    obs, _ = several.reset(seed=[3, 4])
    assert several.single_observation_space.contains(obs[0])
    assert several.observation_space.contains(obs)
    if mode == "sync":
        one = gensim2.make_env("CloseBox", numpy=True, assets="builtin", obs_mode="state")
        assert np.array_equal(one.reset(seed=4)[0], obs[1])
    obs, reward, terminated, truncated, info = several.step(np.zeros((2, 8), dtype=np.float32))
    assert isinstance(obs, np.ndarray)
    assert info["success"].dtype == bool
    assert info["elapsed_steps"].dtype == int
    assert obs.shape[0] == len(reward) == len(terminated) == len(truncated) == 2
    several.close()


def test_wrappers_of_a_vector_environment_wrap_every_environment() -> None:
    wrappers = [lambda env: gym.wrappers.RescaleAction(env, -1.0, 1.0), gym.wrappers.RecordEpisodeStatistics]
    several = gensim2.make_vec_env("CloseBox", 2, "sync", wrappers=wrappers, assets="builtin", max_episode_steps=1)
    assert several.single_action_space == gym.spaces.Box(-1.0, 1.0, (8,))
    several.reset(seed=0)
    assert several.step(np.zeros((2, 8), dtype=np.float32))[4]["episode"]["l"].tolist() == [1, 1]
    several.close()


def test_a_vector_environment_is_described_as_its_environments_are() -> None:
    several = gensim2.make_vec_env("CloseBox", 2, "sync", assets="builtin", obs_mode="state", max_episode_steps=3)
    assert several.spec is not None
    assert several.spec.max_episode_steps == 3
    assert [each.spec.max_episode_steps for each in several.envs] == [3, 3]  # type: ignore[attr-defined]
    several.close()


def test_a_vector_environment_refuses_odd_modes_and_numbers() -> None:
    with pytest.raises(InputError, match="vectorization_mode: must be async, sync or thread"):
        gensim2.make_vec_env("CloseBox", 2, "gpu")
    with pytest.raises(InputError, match="num_envs: must be a whole number and at least 1"):
        gensim2.make_vec_env("CloseBox", 0)


def test_a_closed_environment_says_so(env: GenSim2Env) -> None:
    env.reset(seed=0)
    env.close()
    env.close()
    for use in (lambda: env.step(ZERO), env.reset, env.render, env.scene_state, env.evaluate):
        with pytest.raises(ClosedEnvError, match="is closed"):
            use()

"""The environment without ManiSkill: gymnasium's checker, pictures, and vector environments in threads."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

pytest.importorskip("mujoco")

import gensim2
from gensim2.core.errors import ClosedEnvError, InputError
from gensim2.sim import make_vec_env

GIVEN: dict[str, Any] = {"assets": "builtin", "engine": "mujoco"}


@pytest.mark.filterwarnings("ignore:.*infinity")
@pytest.mark.parametrize("arguments", [{}, {"obs_mode": "raycast", "reward_mode": "normalized_dense"}])
def test_the_checker_of_gymnasium_passes(arguments: dict[str, Any]) -> None:
    env = gensim2.make_env("OpenDrawer", render_mode="rgb_array", **arguments, **GIVEN)
    check_env(env.unwrapped)
    env.reset(seed=3)
    picture = env.render()
    assert isinstance(picture, np.ndarray)
    assert (picture.shape, picture.dtype) == ((480, 640, 3), np.uint8)
    env.close()
    with pytest.raises(ClosedEnvError):
        env.reset()


def test_an_episode_ends_with_the_goal_or_with_its_time() -> None:
    env = gensim2.make_env("CloseBox", **GIVEN)
    _, info = env.reset(seed=1, options={"openness": 0.0})
    assert info["success"] is True
    action = np.append(env.unwrapped.headless.initial_state.start[:7], 1.0)  # type: ignore[attr-defined]
    _, reward, terminated, truncated, _ = env.step(action)
    assert (reward, terminated, truncated) == (1.0, True, False)
    env.reset(seed=1)
    limit = env.unwrapped.headless.max_episode_steps  # type: ignore[attr-defined]
    ends = [env.step(action)[2:4] for _ in range(limit)]
    assert ends[-1] == (False, True)
    assert set(ends[:-1]) == {(False, False)}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"obs_mode": "rgb"}, "obs_mode: must be one of state, raycast"),
        ({"reward_mode": "dense"}, "reward_mode: must be one of"),
        ({"render_mode": "ansi"}, "render_mode"),
        ({"observation": {"points": 512}}, "observation: is used only with obs_mode='raycast'"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*render_mode")
def test_odd_arguments_are_named(arguments: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        gensim2.make_env("OpenDrawer", **arguments, **GIVEN)


def test_threads_give_what_one_after_the_other_gives() -> None:
    found = []
    for mode in ("sync", "thread"):
        envs = make_vec_env("CloseBox", 3, mode, **GIVEN)
        rows = [envs.reset(seed=[5, 6, 7])[0]]
        draw = np.random.default_rng(0)
        for _ in range(20):
            obs, reward, terminated, truncated, _ = envs.step(draw.uniform(-1, 1, (3, 8)).astype(np.float32))
            rows += [obs, reward, terminated, truncated]
        envs.close()
        found.append(rows)
    assert all(np.array_equal(*pair) for pair in zip(*found, strict=True))


def test_sapien_has_no_threads() -> None:
    pytest.importorskip("sapien")
    with pytest.raises(InputError, match="vectorization_mode: thread needs the engine mujoco"):
        make_vec_env("CloseBox", 2, "thread", assets="builtin", engine="sapien")

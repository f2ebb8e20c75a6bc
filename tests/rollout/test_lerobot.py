"""LeRobot's environment and policy with a scripted world and policy; LeRobot is not needed."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scripted import OPEN_DRAWER, ScriptedWorld, glide

from gensim2.perception import EmptyCloudError, ObservationSpec
from gensim2.perception.observation import CLOUD, ENVIRONMENT_STATE, GRIPPER, STATE, TOOL_POSE, VELOCITY
from gensim2.robots import robot
from gensim2.rollout.controller_spec import ControllerError, ControllerSpec
from gensim2.rollout.run import run
from gensim2.tasks.criteria import all_hold
from gensim2.tasks.measurement import Measurement

PLUGINS = Path(__file__).parents[2] / "plugins"
REST = robot("panda").rest_action


class ShownWorld(ScriptedWorld):
    """A scripted world with the additional functions of LeRobot's environment; without images from some step on."""

    blind_from = 10_000
    options: Mapping[str, Any] | None = None

    @property
    def max_episode_steps(self) -> int:
        return self.profile.steps(self.task.max_seconds)

    @property
    def success(self) -> bool:
        return all_hold(self.task.success, self.measure())

    def reset(self, seed: int, options: Mapping[str, Any] | None = None, *, robot: bool = True) -> None:
        self.options = options
        super().reset(seed, options, robot=robot)

    def observe(self, spec: ObservationSpec) -> Any:
        if self.elapsed_steps >= self.blind_from:
            raise EmptyCloudError("the cameras see no point in the workspace")
        return {**super().observe(ObservationSpec(modalities=())).arrays, CLOUD: np.zeros((8, 6), np.float32)}


class Always:
    """A controller that keeps its position and never ends."""

    observation_spec = ObservationSpec(modalities=())

    def reset(self, observation: Any, seed: int) -> None:
        pass

    def act(self, observation: Any) -> Any:
        return REST


def plain(monkeypatch: pytest.MonkeyPatch, name: str) -> Any:
    """Import a plugin's module without its package, which imports LeRobot."""
    package = name.partition(".")[0]
    empty = ModuleType(package)
    empty.__path__ = [str(PLUGINS / package / package)]
    monkeypatch.setitem(sys.modules, package, empty)
    monkeypatch.delitem(sys.modules, name, raising=False)
    found = importlib.import_module(name)
    monkeypatch.delitem(sys.modules, name)
    return found


def environment(monkeypatch: pytest.MonkeyPatch, course: list[Measurement]) -> tuple[Any, ShownWorld]:
    module = plain(monkeypatch, "lerobot_env_gensim2.environment")
    world = ShownWorld(OPEN_DRAWER, course)
    monkeypatch.setattr(module, "HeadlessEnv", lambda task, **scene: world)
    return module.GenSim2Gym("OpenDrawer", ObservationSpec(), {}), world


def played(env: Any) -> tuple[int, bool, bool, dict[str, Any]]:
    """Return the actions of an episode, and how it ended."""
    for count in range(1, 1000):
        _, reward, ended, cut, info = env.step(REST)
        assert reward == float(info["is_success"])
        if ended or cut:
            return count, ended, cut, info
    raise AssertionError("the episode never ends")


FALLS = (20, {"openness": 1.0}), (31, {"openness": 1.0}), (34, {"openness": 0.3}), (60, {"openness": 0.3})


@pytest.mark.parametrize(
    ("course", "success"),
    [
        (glide((0, {"openness": 0.0}), (20, {"openness": 1.0}), (40, {"openness": 1.0})), True),
        (glide((0, {"openness": 0.0}), *FALLS), False),
        (glide((0, {"openness": 0.0}), *FALLS, (70, {"openness": 1.0}), (100, {"openness": 1.0})), True),
        (glide((0, {"openness": 0.0}), (40, {"openness": 0.0})), False),
    ],
    ids=["held", "lost", "lost and found again", "never"],
)
def test_an_episode_of_lerobot_ends_as_one_of_ours(
    monkeypatch: pytest.MonkeyPatch, course: list[Measurement], success: bool
) -> None:
    env, world = environment(monkeypatch, course)
    env.reset(seed=3, options={"instances": "0", "lerobot_new_rollout": True})  # as `lerobot-eval` does
    assert world.options == {"instances": "0"}
    count, ended, cut, info = played(env)
    assert info["is_success"] is success
    assert (ended, cut) == (success, not success)
    ours = run(ScriptedWorld(OPEN_DRAWER, course), Always(), seed=3, stop="goal").episode
    assert world.elapsed_steps == ours.control_steps
    assert ours.held is success
    assert count < world.elapsed_steps, "the last action is held while the scene settles"


def test_a_scene_that_comes_to_no_rest_is_no_success(monkeypatch: pytest.MonkeyPatch) -> None:
    course = glide((0, {"openness": 0.0}), (2, {"openness": 0.95}), (80, {"openness": 1.4}))
    env, _ = environment(monkeypatch, course)
    env.reset(seed=3)
    assert played(env)[1:] == (True, False, {"is_success": False})


def test_cameras_that_see_nothing_any_more_end_an_episode_and_no_evaluation(monkeypatch: pytest.MonkeyPatch) -> None:
    env, world = environment(monkeypatch, glide((0, {"openness": 0.0}), (40, {"openness": 0.0})))
    world.blind_from = 5
    seen, _ = env.reset(seed=3)
    assert played(env) == (5, True, False, {"is_success": False})
    assert set(seen) == {STATE, VELOCITY, TOOL_POSE, GRIPPER, CLOUD}
    env.reset(seed=4)


def test_keypoints_are_the_state_of_lerobot_s_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    module = plain(monkeypatch, "lerobot_env_gensim2.environment")
    spec = ObservationSpec.of({"points": 32, "source": "keypoints"})
    env = module.GenSim2Gym("CloseBox", spec, {"assets": "builtin"})
    seen, _ = env.reset(seed=3)
    assert seen[ENVIRONMENT_STATE].shape == env.observation_space[ENVIRONMENT_STATE].shape == (96,)
    assert (seen[ENVIRONMENT_STATE].reshape(-1, 3) == seen[CLOUD][:, :3]).all()
    assert len(np.unique(seen[CLOUD][:, :3], axis=0)) > 16  # two boxes and keypoints
    env.close()


class Brief(Always):
    """A controller that is done after some actions and must not be called again."""

    def __init__(self, actions: int) -> None:
        self._actions = self._left = actions

    def reset(self, observation: Any, seed: int) -> None:
        self._left = self._actions

    def act(self, observation: Any) -> Any:
        assert self._left >= 0, "it has said that it is done"
        self._left -= 1
        return REST + 0.01 * self._left if self._left >= 0 else None


def policy(monkeypatch: pytest.MonkeyPatch, spec: ControllerSpec) -> Any:
    """LeRobot's policy with a controller, and stand-ins for LeRobot's classes."""
    torch = pytest.importorskip("torch")
    names = ("lerobot", "lerobot.policies", "lerobot.utils", "lerobot.utils.constants")
    config = "lerobot_policy_gensim2.configuration_gensim2"
    for name in (*names, config):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    monkeypatch.setattr(sys.modules["lerobot.policies"], "PreTrainedPolicy", torch.nn.Module, raising=False)
    monkeypatch.setattr(sys.modules["lerobot.utils.constants"], "OBS_STR", "observation", raising=False)
    monkeypatch.setattr(sys.modules[config], "GenSim2Config", SimpleNamespace, raising=False)
    kind = plain(monkeypatch, "lerobot_policy_gensim2.modeling_gensim2").GenSim2Policy
    found = kind.__new__(kind)
    torch.nn.Module.__init__(found)
    found._spec, found._profile = spec, robot("panda")
    found.reset()
    return found


def batch(count: int) -> dict[str, Any]:
    import torch

    sizes = {STATE: (9,), VELOCITY: (9,), TOOL_POSE: (7,), GRIPPER: (2,), CLOUD: (8, 6)}
    arrays = {f"observation.{name}": torch.zeros(count, *size) for name, size in sizes.items()}
    return {**arrays, "task": ["open the drawer"] * count}


def test_a_policy_that_is_done_is_asked_no_more_and_stays_until_it_is_reset(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "brief_controller", SimpleNamespace(Brief=Brief))  # type: ignore[arg-type]
    found = policy(monkeypatch, ControllerSpec("brief_controller:Brief", {"actions": 2}))
    for _ in range(2):
        given = [found.select_action(batch(2)).numpy() for _ in range(6)]
        np.testing.assert_allclose(given[0], np.stack([REST + 0.01] * 2))
        for each in given[1:]:
            np.testing.assert_allclose(each, np.stack([REST] * 2))
        found.reset()


def test_a_policy_with_wrong_arguments_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "brief_controller", SimpleNamespace(Brief=Brief))  # type: ignore[arg-type]
    found = policy(monkeypatch, ControllerSpec("brief_controller:Brief", {"minutes": 2}))
    with pytest.raises(ControllerError, match="cannot be made: TypeError"):
        found.select_action(batch(1))

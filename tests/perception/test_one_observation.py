"""An observation of a state is the same, byte for byte, in the environment, headless, when rendering, and for a
controller.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gensim2.core.errors import InputError
from gensim2.core.seeding import rng
from gensim2.data.observing import observe
from gensim2.perception import CloudSettings, DepthNoise, Observation, ObservationSpec
from gensim2.perception.observation import cloud_column
from gensim2.robots import load_robot
from gensim2.rollout.recording import Recorder
from gensim2.rollout.run import run
from gensim2.scenes.config import SceneOptions
from gensim2.sim.env import GenSim2Env
from gensim2.sim.headless import HeadlessEnv

TASKS = ("OpenDrawer", "CloseBox", "TurnOnFaucet", "OpenLaptop", "PlaceGolfBallIntoDrawer")
ROBOTS = ("panda", "fetch", load_robot(Path(__file__).parents[2] / "examples" / "robots" / "xarm7.py"))
STATES = 7
"""Number of states per robot and task: 105 in total."""
SPEC = ObservationSpec(
    ("pointcloud", "depth", "segmentation"),
    ("left", "front"),
    CloudSettings(points=128, candidates=512, noise=DepthNoise()),
)


def as_bytes(arrays: Any) -> dict[str, tuple[str, tuple[int, ...], bytes]]:
    return {name: (str(a.dtype), a.shape, np.ascontiguousarray(a).tobytes()) for name, a in arrays.items()}


def of_file(arrays: dict[str, Any], step: int) -> dict[str, Any]:
    """Return a row of a data set under the names of an observation's arrays."""
    from gensim2.perception.cloud import from_steps

    names = {"qpos": "state", "qvel": "velocity", "tool_pose": "tool_pose", "gripper": "gripper"}
    found = {own: arrays[f"proprioception/{name}"][step] for name, own in names.items()}
    for camera in SPEC.cameras:
        found |= {f"{what}_{camera}": arrays[f"cameras/{camera}/{what}"][step] for what in ("depth", "segmentation")}
    found["point_cloud"] = cloud_column(from_steps(arrays["pointcloud/xyz"][step]), arrays["pointcloud/rgb"][step])
    found["point_segmentation"] = arrays["pointcloud/segmentation"][step]
    return found


class Plays:
    """Gives actions in order and keeps its observations."""

    observation_spec = SPEC

    def __init__(self, actions: list[Any]) -> None:
        self._actions = actions

    def reset(self, observation: Observation, seed: int) -> None:
        self.seen: list[Observation] = []

    def act(self, observation: Observation) -> Any:
        self.seen.append(observation)
        return self._actions[observation.step] if observation.step < len(self._actions) else None


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("robot", ROBOTS, ids=lambda name: Path(name).stem)
def test_environment_headless_rendering_and_controllers_see_the_same(robot: str, task: str) -> None:
    draw = rng(5, f"{Path(robot).stem}/{task}")
    env = GenSim2Env(task, assets="builtin", robot=robot, obs_mode="raycast", observation=SPEC.to_dict())
    lane = HeadlessEnv(task, assets="builtin", robot=robot)
    seen, _ = env.reset(seed=3)
    lane.reset(seed=3)
    recorder = Recorder(lane)
    found: list[Observation] = []
    actions: list[Any] = []
    for step in range(STATES):
        found.append(lane.observe(SPEC))
        assert as_bytes({name: each[0].numpy() for name, each in seen.items()}) == as_bytes(found[-1])
        assert found[-1].step == step
        assert found[-1].time == step / lane.profile.control_hz
        assert found[-1].language == lane.task.description
        action = lane.profile.rest_action + draw.uniform(-0.2, 0.2, lane.profile.action_size).astype(np.float32)
        seen, *_ = env.step(action)
        lane.step(action)
        recorder.add(action, lane.measure())
        actions.append(action)
    env.close()
    scene = SceneOptions("builtin", robot=robot).with_task(lane.task)
    rendered = observe(recorder.finish(), scene, SPEC)
    assert len(rendered["proprioception/qpos"]) == STATES + 1
    for step, observation in enumerate(found):
        assert as_bytes(of_file(rendered, step)) == as_bytes(observation)
    player = Plays(actions)
    run(lane, player, seed=3)
    for observation, shown in zip(found, player.seen, strict=False):
        assert as_bytes(shown) == as_bytes(observation)
    assert len(player.seen) == STATES + 1


def test_the_tool_pose_is_in_the_base_frame_and_the_gripper_says_what_it_was_told() -> None:
    lane = HeadlessEnv("OpenDrawer", assets="builtin")
    lane.reset(seed=1)
    spec = ObservationSpec(modalities=())
    start = lane.observe(spec)
    assert set(start) == {"state", "velocity", "tool_pose", "gripper"}
    assert start.gripper_command == 1.0
    assert start.gripper_width == pytest.approx(0.08, abs=2e-3)
    T_base_hand = lane.profile.model.forward_kinematics(lane.q)
    assert np.allclose(start.T_base_tool[:3, :3], T_base_hand[:3, :3], atol=1e-6)
    assert np.linalg.norm(start.T_base_tool[:3, 3] - T_base_hand[:3, 3]) == pytest.approx(0.1034, abs=1e-3)
    closing = lane.profile.rest_action.copy()
    closing[-1] = -0.5
    lane.step(closing)
    assert lane.observe(spec).gripper_command == -0.5


def test_specs_are_plain_data_and_say_what_differs() -> None:
    assert ObservationSpec.of(SPEC.to_dict()) == SPEC
    assert ObservationSpec.of({"points": 64, "candidates": 256}).cloud.points == 64
    assert ObservationSpec(cameras=("front", "left")) == ObservationSpec(cameras=("left", "front"))
    other = ObservationSpec(SPEC.modalities, SPEC.cameras, CloudSettings(points=64, candidates=512, noise=DepthNoise()))
    with pytest.raises(
        InputError, match=r"observation\.cloud\.points: the value is 64 in the data, but 128 in the controller"
    ):
        SPEC.require(other, "the data", of="the controller")
    SPEC.require(SPEC, "the data", of="the controller")
    for given in ({"smell": 1}, {"modalities": "smell"}, {"cloud": 3}, 7):
        with pytest.raises(InputError):
            ObservationSpec.of(given)  # type: ignore[arg-type]

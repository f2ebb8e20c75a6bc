"""A camera on a link: the joints give its pose, and it sees the same as a fixed camera there."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mani_skill")

from gensim2.core.errors import InputError
from gensim2.data.formats.seen_table import NAME, SeenTable
from gensim2.data.observation_file import ObservedEpisode
from gensim2.data.observing import observe
from gensim2.perception import CloudSettings, ObservationSpec
from gensim2.perception.raycast.observer import Observer
from gensim2.perception.raycast.scene import RaycastScene
from gensim2.robots import MountedCamera, load_robot, robot
from gensim2.robots.checks import check_profile
from gensim2.rollout.recording import Recorder
from gensim2.scenes.config import SceneOptions
from gensim2.sim.env import GenSim2Env
from gensim2.sim.headless import HeadlessEnv
from gensim2.sim.rendering import can_render

FILE = load_robot(Path(__file__).parents[1] / "robots" / "wristed.py")
SPEC = ObservationSpec(
    ("pointcloud", "depth", "segmentation"), ("wrist", "front"), CloudSettings(points=128, candidates=512)
)
DOWN = np.array([0.0, 0.1, 0.0, 0.0, 0.0, 0.1, 0.3, 0.0], dtype=np.float32)


def states(lane: HeadlessEnv) -> dict[str, Any]:
    return {kind: {name: row[None] for name, row in rows.items()} for kind, rows in lane.state().items()}


def test_it_goes_with_its_link_and_sees_what_a_fixed_camera_there_would() -> None:
    lane = HeadlessEnv("OpenDrawer", assets="builtin", robot=FILE)
    lane.reset(seed=3)
    models = {name: thing.model for name, thing in lane.initial_state.objects.items()}
    observer = Observer(lane.profile, models, SPEC, seed=3)
    (carried,) = lane.profile.cameras
    for step in range(4):
        seen = lane.observe(SPEC)
        camera = seen.cameras["wrist"]
        T_base_hand = lane.profile.model.forward_kinematics(lane.q)
        assert np.allclose(camera.T_base_camera, T_base_hand @ carried.T_link_camera, atol=1e-6)
        assert seen["depth_wrist"].shape == (64, 96)
        fixed = RaycastScene(lane.profile, models, [replace(camera, link=None)])
        (expected,) = fixed.see(fixed.poses(states(lane))[0])
        assert np.abs(seen["depth_wrist"] - 1000.0 * expected.depth).max() < 1.0
        assert np.mean(seen["segmentation_wrist"] == expected.segmentation) > 0.999
        own = set(observer.scene.robot.gripper)
        assert own & set(np.unique(seen["segmentation_wrist"]).tolist()), "it looks at the fingers"
        # For this camera, objects on the table are at its height.
        table = seen["segmentation_wrist"] == observer.scene.ids("table")[0]
        along = (seen["depth_wrist"][..., None] / 1000.0 * camera.rays + camera.position)[table]
        assert len(along) > 100
        assert np.median(np.abs(along[:, 2] + lane.profile.base_position[2])) < 2e-3, step
        lane.step(lane.profile.rest_action + step * DOWN)


def test_environment_headless_and_rendering_see_the_same(tmp_path: Path) -> None:
    env = GenSim2Env("OpenDrawer", assets="builtin", robot=FILE, obs_mode="raycast", observation=SPEC.to_dict())
    lane = HeadlessEnv("OpenDrawer", assets="builtin", robot=FILE)
    seen, _ = env.reset(seed=2)
    lane.reset(seed=2)
    recorder, found = Recorder(lane), [lane.observe(SPEC)]
    for step in range(3):
        assert all(np.array_equal(seen[name][0].numpy(), array) for name, array in found[-1].items()), step
        action = lane.profile.rest_action + step * DOWN
        seen, *_ = env.step(action)
        lane.step(action)
        recorder.add(action, lane.measure())
        found.append(lane.observe(SPEC))
    env.close()
    arrays = observe(recorder.finish(), SceneOptions("builtin", robot=FILE).with_task(lane.task), SPEC)
    for step, observation in enumerate(found):
        assert np.array_equal(arrays["cameras/wrist/depth"][step], observation["depth_wrist"])
        assert np.allclose(
            arrays["cameras/wrist/T_base_camera"][step], observation.cameras["wrist"].T_base_camera, atol=1e-6
        )
    table = SeenTable()
    description = {**SPEC.to_dict(), "camera_links": {"wrist": "panda_hand"}}
    table.add("OpenDrawer", 0, ObservedEpisode(description, arrays))
    table.write(tmp_path)
    told = json.loads((tmp_path / NAME).read_text())["cameras"]
    assert told["wrist"].keys() == {"intrinsic", "T_link_camera", "link"}
    assert np.allclose(told["wrist"]["T_link_camera"], lane.profile.cameras[0].T_link_camera)
    assert told["front"].keys() == {"intrinsic", "T_base_camera"}


@pytest.mark.skipif(not can_render(), reason="no Vulkan driver works on this machine")
def test_pictures_are_those_of_the_renderer() -> None:
    from gensim2.sim.pictures import StatePictures

    lane = HeadlessEnv("OpenDrawer", assets="builtin", robot=FILE)
    lane.reset(seed=6)
    for step in range(4):
        lane.step(lane.profile.rest_action + step * DOWN)
    seen = lane.observe(SPEC)
    config = SceneOptions("builtin", robot=FILE).with_task(lane.task)
    pictures = StatePictures(config, ("depth", "segmentation"))
    instances = {name: thing.model.id for name, thing in lane.initial_state.objects.items()}
    pictures.show(instances, 6, {"instance": instances})
    theirs = pictures.at(states(lane), 0)["wrist"]
    pictures.close()
    same = theirs["segmentation"] == seen["segmentation_wrist"]
    assert same.mean() > 0.99
    apart = np.abs(theirs["depth"].astype(int) - seen["depth_wrist"])[same & (theirs["segmentation"] > 0)]
    assert (apart <= 2).mean() > 0.99


def test_cameras_that_there_are_not_are_refused() -> None:
    lane = HeadlessEnv("OpenDrawer", assets="builtin")
    lane.reset(seed=0)
    with pytest.raises(InputError, match=r"panda has no camera 'wrist' .*left, right, front"):
        lane.observe(SPEC)
    with pytest.raises(InputError, match="cameras"):
        ObservationSpec(cameras=("left", "Not A Name"))
    profile = robot(FILE)
    (camera,) = profile.cameras
    for wrong, message in (
        (MountedCamera("wrist", "nowhere", camera.T_link_camera), "no link 'nowhere'"),
        (MountedCamera("wrist", "panda_hand", 2.0 * np.eye(4)), "rigid transform"),
        (MountedCamera("a/b", "panda_hand", np.eye(4)), "a camera name must have"),
        (MountedCamera("wrist", "panda_hand", np.eye(4), 0), "must be at least 1 pixel"),
    ):
        with pytest.raises(InputError, match=message):
            check_profile(replace(profile, cameras=(wrong,)), "mine.py")
    with pytest.raises(InputError, match="two cameras are named 'wrist'"):
        check_profile(replace(profile, cameras=(camera, camera)), "mine.py")

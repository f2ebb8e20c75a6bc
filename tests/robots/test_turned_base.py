"""A rotated base: the world is unchanged, data in the base frame is rotated, and tasks still succeed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mani_skill")

from gensim2.perception import CloudSettings, ObservationSpec
from gensim2.robots import load_robot, robot
from gensim2.rollout.chain import ChainController
from gensim2.rollout.run import run
from gensim2.sim.env import GenSim2Env
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.library import load_strategies, load_task

FILE = load_robot(Path(__file__).with_name("turned.py"))
SPEC = ObservationSpec(("pointcloud", "depth"), ("left", "front"), CloudSettings(points=128, candidates=512))
TURNED = robot(FILE).T_world_base[:3, :3]


def test_the_scene_is_the_same_in_the_world_and_turned_in_the_base_frame() -> None:
    straight, turned = (HeadlessEnv("OpenDrawer", assets="builtin", robot=name) for name in ("panda", FILE))
    for env in (straight, turned):
        env.reset(4)
    for step in range(6):
        seen, other = straight.observe(SPEC), turned.observe(SPEC)
        assert np.allclose(TURNED @ other.T_base_tool[:3], seen.T_base_tool[:3], atol=1e-4)
        assert seen.cloud is not None
        assert other.cloud is not None
        # Depth belongs to the cameras, which are fixed in the world; rays at edges may hit either surface.
        for camera in SPEC.cameras:
            apart = np.abs(seen[f"depth_{camera}"].astype(int) - other[f"depth_{camera}"])
            assert np.mean(apart > 2) < 0.01, step
        middle, others = (each.cloud.xyz.mean(axis=0) for each in (seen, other) if each.cloud is not None)
        assert np.allclose(TURNED @ others, middle, atol=0.03)
        for name in ("drawer", "object"):
            if name in straight.measure().openness:
                assert straight.measure().openness[name] == pytest.approx(turned.measure().openness[name], abs=1e-4)
        for name, point in straight.measure().gripper.items():
            assert turned.measure().gripper[name] == pytest.approx(point, abs=1e-4)
        down = np.zeros(8, dtype=np.float32)
        down[1] = 0.05 * step
        straight.step(straight.profile.rest_action + down)
        turned.step(turned.profile.rest_action + down)


def test_the_environment_is_the_headless_one() -> None:
    env = GenSim2Env("OpenDrawer", assets="builtin", robot=FILE, obs_mode="raycast", observation=SPEC.to_dict())
    lane = HeadlessEnv("OpenDrawer", assets="builtin", robot=FILE)
    seen, _ = env.reset(seed=2)
    lane.reset(seed=2)
    for name, array in lane.observe(SPEC).items():
        assert np.array_equal(seen[name][0].numpy(), array), name
    assert env.unwrapped.scene_state().T_world_base == pytest.approx(robot(FILE).T_world_base)  # type: ignore[attr-defined]
    env.close()


@pytest.mark.parametrize(("task", "seed"), [("OpenDrawer", 0), ("CloseBox", 0)])
def test_tasks_are_done_with_the_librarys_strategies(task: str, seed: int) -> None:
    env = HeadlessEnv(task, assets="builtin", robot=FILE)
    controller = ChainController(load_task(task), load_strategies(task), env.profile)
    episode = run(env, controller, seed=seed).episode
    assert episode.held, episode.diagnosis

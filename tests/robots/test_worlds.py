"""Every robot in the environment and in the headless environment gives the same states, bit for bit."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

pytest.importorskip("mani_skill")

import sapien
from sapien import physx

import gensim2.sim
from gensim2.core.errors import InputError
from gensim2.robots import robot
from gensim2.rollout.config import EpisodeConfig
from gensim2.rollout.worker import episode
from gensim2.scenes.config import SceneOptions
from gensim2.scenes.table import HALF_SIZE
from gensim2.sim.arm import Arm
from gensim2.sim.env import GenSim2Env
from gensim2.sim.headless import HeadlessEnv
from gensim2.sim.physics import DEFAULT
from gensim2.tasks.library import load_strategies, load_task


def test_the_headless_environment_is_the_environment(any_robot: str) -> None:
    profile, draw = robot(any_robot), np.random.default_rng(5)
    env = GenSim2Env("OpenDrawer", assets="builtin", robot=any_robot)
    lane = HeadlessEnv("OpenDrawer", assets="builtin", robot=any_robot)
    for seed in range(3):
        obs, _ = env.reset(seed=seed)
        lane.reset(seed)
        assert np.array_equal(obs[0].numpy(), lane.observation())
        assert lane.q == pytest.approx(profile.reset_qpos)
        # Down and forward into the object, with noise.
        target = profile.rest_action.copy()
        for _ in range(40):
            target[1] += 0.04
            target[-1] = draw.choice([-1.0, 1.0])
            action = target + draw.normal(0.0, 0.05, profile.action_size).astype(np.float32)
            obs, *_ = env.step(action)
            lane.step(action)
            assert np.array_equal(obs[0].numpy(), lane.observation())
        states = env.get_state_dict()["articulations"]
        assert set(states) == set(lane.state()["articulations"])
        for part, state in lane.state()["articulations"].items():
            assert np.array_equal(states[part][0].numpy(), state)
    env.close()


def test_the_robot_is_a_keyword_of_the_registered_environment() -> None:
    assert gensim2.sim
    env = gym.make("GenSim2-OpenDrawer-v1", assets="builtin", robot="fetch", obs_mode="state")
    env.reset(seed=0)
    inside = env.unwrapped
    assert isinstance(inside, GenSim2Env)
    assert inside.agent.uid == inside.robot_uids == robot("fetch").agent
    assert inside.scene_state().T_world_base[:3, 3] == pytest.approx(robot("fetch").base_position)
    assert env.spec is not None
    assert env.spec.kwargs["robot"] == "fetch"
    env.close()


def test_robots_that_contradict_each_other_are_refused() -> None:
    with pytest.raises(InputError) as refused:
        GenSim2Env(task="OpenDrawer", robot="panda", robot_uids="fetch")
    assert refused.value.field == "robot_uids"
    for make in (GenSim2Env, HeadlessEnv):
        with pytest.raises(InputError, match="no robot 'r2d2'"):
            make("OpenDrawer", robot="r2d2")


def corners_of(shape: physx.PhysxCollisionShape) -> np.ndarray:
    """Return corners (N, 3) of a hull, of a box, or of the box around a cylinder along x, in the shape's frame."""
    if isinstance(shape, physx.PhysxCollisionShapeConvexMesh):
        return shape.vertices * shape.scale
    half = (
        shape.half_size
        if isinstance(shape, physx.PhysxCollisionShapeBox)
        else np.array([shape.half_length, shape.radius, shape.radius])
    )
    return half * np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).T.reshape(-1, 3)


def test_it_stands_clear_of_the_table(any_robot: str) -> None:
    """Every hull is above the table, below it or behind its edge, because planners check moving links only."""
    profile = robot(any_robot)
    scene = sapien.Scene([DEFAULT.new_system(profile)])
    arm = Arm(scene, profile, DEFAULT)
    arm.put(profile.reset_qpos)
    count = 0
    for link in arm.articulation.links:
        pose = link.entity.pose.to_transformation_matrix()
        for shape in link.collision_shapes:
            local = pose @ shape.local_pose.to_transformation_matrix()
            points = corners_of(shape) @ local[:3, :3].T + local[:3, 3]
            low, high = points.min(axis=0), points.max(axis=0)
            assert low[2] > -0.002 or high[2] < -2 * HALF_SIZE[2] or high[0] < -HALF_SIZE[0], link.name
            count += 1
    assert count > 8


def test_at_rest_it_stays_where_it_is(any_robot: str) -> None:
    """It touches neither itself nor the table."""
    profile = robot(any_robot)
    lane = HeadlessEnv("OpenDrawer", assets="builtin", robot=any_robot)
    lane.reset(0, {"offset": [0.3, 0.0, 0.0]})
    for _ in range(20):
        lane.step(profile.rest_action)
    assert lane.q[: profile.arm_size] == pytest.approx(profile.reset_qpos[: profile.arm_size], abs=1e-5)
    links = {link.name for link in lane._robot.articulation.links}
    touching = [
        {body.entity.name for body in contact.bodies}
        for contact in lane._scene.scene.get_contacts()
        if any(np.linalg.norm(point.impulse) > 0 for point in contact.points)
    ]
    assert [pair for pair in touching if pair & links] == []


def test_in_mujoco_it_stands_where_it_is_and_its_fingers_go_all_the_way(any_robot: str) -> None:
    """As in SAPIEN: at rest within 2 cm/s or 0.02 rad, and the fingers within 4 mm of their target after their time."""
    pytest.importorskip("mujoco")
    env = HeadlessEnv("OpenDrawer", assets="builtin", robot=any_robot, engine="mujoco")
    profile = env.profile
    env.reset(0)
    start = env.q
    for _ in range(profile.control_hz):
        env.step(profile.rest_action)
    assert env.is_finite
    assert np.abs(env.q - start)[: profile.arm_size].max() < 0.02
    assert env.touched() == frozenset()
    for command, opening in ((-1.0, 0.0), (1.0, profile.gripper.widest)):
        for _ in range(profile.gripper_steps):
            env.step(np.append(profile.rest_action[:-1], command))
        assert env.measure().finger_opening == pytest.approx(opening, abs=4e-3)


def test_in_mujoco_it_closes_a_box(any_robot: str) -> None:
    """Planned with the library's strategies and executed, closed loop."""
    pytest.importorskip("mujoco")
    scene = SceneOptions("builtin", robot=any_robot, engine="mujoco").with_task(load_task("CloseBox"), "new")
    found = episode(EpisodeConfig(scene), load_strategies("CloseBox"), seed=3)
    assert found.held, found.cause

"""The headless environment gives the states of the registered environment, bit for bit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gensim2.core.errors import GenSim2Error, InputError
from gensim2.robots import robot
from gensim2.sim.env import GenSim2Env
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.library import task_names
from gensim2.tasks.parse import parse_task
from gensim2.tasks.spec import TaskSpec

EPISODES = 110
PANDA = robot("panda")
HOLD = np.array([*PANDA.reset_qpos[:7], 1.0], dtype=np.float32)


def _several(name: str, *others: tuple[str, float, float]) -> TaskSpec:
    """Return a container ahead, and rigid objects on the table beside it."""
    objects: dict[str, Any] = {name: {"class": name, "randomization": {"x": 0.05, "y": [0.0, 0.05]}}}
    for other, x, y in others:
        objects[other] = {"class": other, "place": {"at": [x, y]}, "randomization": {"x": 0.05, "y": 0.05}}
    done = {"type": "distance_articulated_rigidbody", "articulated": name, "rigid": others[0][0]}
    step = {"name": "fill", "object": others[0][0], "strategies": ["any"], "done": [done]}
    return parse_task({"name": "Fill", "description": "fill it", "objects": objects, "steps": [step]})


SEVERAL = [
    _several("drawer", ("golf_ball", -0.2, -0.45), ("bowl", -0.2, 0.45)),
    _several("box_rotate", ("cracker_box", -0.2, -0.45), ("mug", -0.25, 0.4)),
]


def _reaching(target: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return joints (7,) with the tool near a point in the base frame, by a few damped Jacobian steps."""
    q = q.copy()
    for _ in range(20):
        pose = PANDA.model.forward_kinematics(q)
        error = target - (pose[:3, :3] @ PANDA.tool_keypoints["tool_head"] + pose[:3, 3])
        J = PANDA.model.jacobian(q)[:3, :7]
        q[:7] += J.T @ np.linalg.solve(J @ J.T + 0.01 * np.eye(3), error)
        q = np.clip(q, PANDA.model.lower, PANDA.model.upper)
    return q[:7]


def _actions(lane: HeadlessEnv, rng: np.random.Generator) -> np.ndarray:
    """Return actions of a hand that moves between keypoints, opens and closes, with noise in half of the episodes, so
    that it pushes, slips, grasps and hits.
    """
    scene = lane.scene_state()
    points = [point for thing in scene.objects.values() for point in thing.keypoints.values()]
    q, rows = scene.q, [HOLD[:7]]
    for _ in range(4):
        target = points[int(rng.integers(len(points)))] + rng.normal(0.0, 0.02, 3)
        there = _reaching(target, np.concatenate([rows[-1], q[7:]]).astype(np.float64))
        rows += list(np.linspace(rows[-1], there, int(rng.integers(8, 20))))
    arm = np.array(rows)
    arm += rng.normal(0.0, 0.03, arm.shape) * (rng.random() < 0.5)
    grip = np.where(np.sin(np.arange(len(arm)) * rng.uniform(0.05, 0.3)) > 0, -1.0, 1.0)
    return np.column_stack([np.clip(arm, -2.8, 2.8), grip]).astype(np.float32)


def _check_equal_episodes(task: str | TaskSpec, seeds: range) -> int:
    """Run episodes in both; return in how many an object moved."""
    env, lane = GenSim2Env(task, assets="builtin"), HeadlessEnv(task, assets="builtin")
    rng = np.random.default_rng(len(lane.task.name))
    moved = 0
    for seed in seeds:
        obs, _ = env.reset(seed=seed)
        lane.reset(seed)
        assert np.array_equal(obs[0].numpy(), lane.observation())
        before = lane.measure()
        for action in _actions(lane, rng):
            obs, reward, terminated, truncated, info = env.step(action)
            lane.step(action)
            assert np.array_equal(obs[0].numpy(), lane.observation())
            assert lane.success == bool(info["success"][0]) == bool(terminated[0]) == bool(reward[0])
        states = env.get_state_dict()
        for kind, parts in lane.state().items():
            assert set(parts) == set(states.get(kind, {}))
            for part, state in parts.items():
                assert np.array_equal(states[kind][part][0].numpy(), state)
        after, watched = lane.measure(), env.measure()
        assert repr(after) == repr(watched)
        assert repr(lane.scene_state()) == repr(env.scene_state())
        assert lane.elapsed_steps == int(env.elapsed_steps[0])
        assert bool(truncated[0]) == (lane.elapsed_steps >= lane.max_episode_steps)
        moved += any(
            np.linalg.norm(start - end) > 0.01
            for name, points in before.keypoints.items()
            for start, end in zip(points.values(), after.keypoints[name].values(), strict=True)
        )
    return moved


@pytest.mark.parametrize("name", task_names("paper"))
def test_states_and_observations_are_those_of_the_environment(name: str) -> None:
    assert _check_equal_episodes(name, range(-(-EPISODES // len(task_names("paper"))))) > 0


@pytest.mark.parametrize("task", SEVERAL, ids=lambda task: "-".join(task.objects))
def test_several_objects_are_where_the_environment_has_them(task: TaskSpec) -> None:
    assert _check_equal_episodes(task, range(8)) > 3


def test_reset_options_are_those_of_the_environment(crates: Callable[..., Any], crate_task: TaskSpec) -> None:
    library = crates(2, damping=0.05)
    env, lane = GenSim2Env(crate_task, assets=library), HeadlessEnv(crate_task, assets=library)
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
        lane = HeadlessEnv(crate_task, assets=crates(friction=friction))
        for seed in range(3):
            lane.reset(seed)
            for _ in range(100):
                lane.step(HOLD)
            beside, hand = lane.measure(), lane.measure().gripper
            lane.reset(seed, robot=False)
            assert lane.measure().finger_opening == pytest.approx(beside.finger_opening, abs=1e-3)
            for name, point in lane.measure().gripper.items():  # as if at rest
                assert point == pytest.approx(hand[name], abs=2e-3)
            for _ in range(100):
                lane.wait()
            assert lane.success == (friction < 0.1)
            assert lane.measure().openness["crate"] == pytest.approx(beside.openness["crate"], abs=0.01)


def test_what_cannot_be_used_is_refused(crates: Callable[..., Any], crate_task: TaskSpec) -> None:
    lane = HeadlessEnv(crate_task, assets=crates())
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


def test_a_nudge_moves_one_object_and_nothing_else() -> None:
    lane = HeadlessEnv(SEVERAL[0], assets="builtin")
    lane.reset(3)
    for _ in range(20):
        lane.step(HOLD)
    before = lane.measure()
    lane.nudge("golf_ball", 0.03, -0.01)
    lane.nudge("drawer", dx=0.02, dyaw=0.1)
    after = lane.measure()
    assert after.poses["golf_ball"][:3] - before.poses["golf_ball"][:3] == pytest.approx([0.03, -0.01, 0.0], abs=1e-6)
    assert after.speeds["golf_ball"] == pytest.approx([0.0, 0.0])
    assert np.array_equal(after.poses["bowl"], before.poses["bowl"])
    assert after.openness == before.openness
    for _ in range(20):
        lane.step(HOLD)
    settled = lane.measure()
    assert settled.poses["golf_ball"][:2] == pytest.approx(after.poses["golf_ball"][:2], abs=2e-3)
    root = lane.initial_state.objects["drawer"]
    turned = lane.scene_state().objects["drawer"].T_base_object
    assert not np.allclose(turned[:3, :3], np.eye(3))
    assert lane.parts["drawer"].observed()["pose"][0] == pytest.approx(root.position[0] + 0.02, abs=1e-6)
    assert settled.openness["drawer"] == pytest.approx(before.openness["drawer"], abs=1e-3)
    with pytest.raises(InputError, match="no object 'cup' "):
        lane.nudge("cup")

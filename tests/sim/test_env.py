"""The environment: reproducible scenes, measurements, and errors."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import warm

import gensim2.sim
from gensim2.core.errors import GenSim2Error, InputError
from gensim2.core.seeding import rng
from gensim2.objects import open_library
from gensim2.robots import robot
from gensim2.scenes.randomize import Draw, draw_object
from gensim2.sim.env import GenSim2Env
from gensim2.tasks.library import load_task, task_names
from gensim2.tasks.parse import parse_task
from gensim2.tasks.presets import preset
from gensim2.tasks.spec import TaskSpec

RESET_QPOS, BASE_POSITION = robot("panda").reset_qpos, robot("panda").base_position
HOLD = np.array([*RESET_QPOS[:7], 1.0], dtype=np.float32)
REACH = np.array([0.0, 0.45, 0.0, -2.0, 0.0, 2.45, 0.785, 1.0], dtype=np.float32)


def _state(env: Any) -> bytes:
    return np.asarray(env.unwrapped.get_state()).tobytes()


@pytest.mark.parametrize("name", task_names("paper"))
def test_every_library_task_makes_steps_and_describes_its_scene(name: str) -> None:
    env = gym.make(f"GenSim2-{name}-v1", assets="builtin", obs_mode="state_dict")
    obs, info = env.reset(seed=1)
    base = env.unwrapped
    assert obs["agent"]["qpos"][0].tolist() == pytest.approx(RESET_QPOS)
    assert not bool(info["success"][0])
    role = next(iter(base.task.objects))
    opens = base.task.success[0].type == "articulated_open"
    assert 0.0 <= base.measure().openness[role] < 0.7 if opens else 0.3 < base.measure().openness[role] <= 1.0
    obs, reward, terminated, truncated, info = env.step(HOLD)
    assert reward.dtype.is_floating_point
    assert float(reward[0]) == 0.0
    assert not bool(terminated[0] | truncated[0])
    scene = base.scene_state()
    thing = scene.objects[role]
    assert [body.name for body in scene.fixtures] == ["table"]
    assert thing.joint is not None
    assert len(thing.joint.moves) == 1
    assert set(thing.joint.moves) <= {body.name for body in thing.bodies}
    assert all(body.name.startswith(f"{role}/") for body in thing.bodies)
    assert list(thing.keypoints) == list(base.initial_state.objects[role].model.keypoints)
    assert all(0.15 < np.linalg.norm(point) < 1.2 for point in thing.keypoints.values())
    assert thing.joint.openness == pytest.approx(base.measure().openness[role])
    assert scene.held is None
    assert not scene.qvel.any()
    env.close()


def test_the_scene_is_in_the_base_frame_and_agrees_with_itself(
    crates: Callable[..., Any], crate_task: TaskSpec
) -> None:
    env = GenSim2Env(crate_task, assets=crates())
    env.reset(seed=0, options={"openness": 0.5, "offset": [0.05, -0.02, 0.3]})
    scene = env.scene_state()
    thing = scene.objects["crate"]
    assert scene.q == pytest.approx(np.array(RESET_QPOS))
    # The lid's front edge, computed by hand: hinge at (0.1, 0, 0.102), 0.2 m long, 0.75 rad open, turned by 0.3 rad.
    edge = np.array([0.1 - 0.2 * np.cos(0.75), 0.0, 0.102 + 0.2 * np.sin(0.75)])
    yaw = np.array([[np.cos(0.3), -np.sin(0.3), 0], [np.sin(0.3), np.cos(0.3), 0], [0, 0, 1]])
    expected = yaw @ edge + [0.05, -0.02, 0.0] - np.array(BASE_POSITION)
    assert thing.keypoints["articulated_object_head"] == pytest.approx(expected, abs=1e-5)
    assert thing.joint.axis == pytest.approx(yaw @ [0.0, 1.0, 0.0], abs=1e-5)
    hinge = yaw @ [0.1, 0.0, 0.102] + [0.05, -0.02, 0.0] - np.array(BASE_POSITION)
    assert thing.joint.origin == pytest.approx(hinge, abs=1e-5)
    assert thing.yaw == pytest.approx(0.3)
    # At joint value zero, the object frame has y up and z towards the robot; opening turns it about its own x.
    opened = np.array([np.sin(0.75), 0.0, np.cos(0.75)])
    assert thing.T_base_object[:3, 1] == pytest.approx(yaw @ opened, abs=1e-5)
    lid = next(body for body in thing.bodies if body.name in thing.joint.moves)
    corners = lid.hulls[0] @ lid.T_base_body[:3, :3].T + lid.T_base_body[:3, 3]
    assert np.min(np.linalg.norm(corners - expected, axis=1)) < 0.102
    (table,) = scene.fixtures
    assert np.max(table.hulls[0][:, 2]) + table.T_base_body[2, 3] == pytest.approx(0.0)


def test_following_the_joint_moves_keypoints_as_the_scene_says(
    crates: Callable[..., Any], crate_task: TaskSpec
) -> None:
    """Turning a keypoint about the scene's axis by the change of value gives the keypoint of the opened scene."""
    env = GenSim2Env(crate_task, assets=crates())
    scenes = []
    for openness in (0.3, 0.6):
        env.reset(seed=4, options={"openness": openness})
        scenes.append(env.scene_state().objects["crate"])
    angle = scenes[1].joint.value - scenes[0].joint.value
    axis, origin = scenes[0].joint.axis, scenes[0].joint.origin
    arm = scenes[0].keypoints["articulated_object_head"] - origin
    turned = arm * np.cos(angle) + np.cross(axis, arm) * np.sin(angle) + axis * (axis @ arm) * (1 - np.cos(angle))
    assert origin + turned == pytest.approx(scenes[1].keypoints["articulated_object_head"], abs=1e-5)


def test_the_same_seed_gives_the_same_states_bit_for_bit(crates: Callable[..., Any], crate_task: TaskSpec) -> None:
    env = GenSim2Env(crate_task, assets=crates(2))
    runs = []
    for seed in (5, 6, 5):
        env.reset(seed=seed)
        states = [_state(env)]
        for _ in range(50):  # the arm touches the lid
            env.step(REACH)
            states.append(_state(env))
        runs.append(states)
    assert runs[0] == runs[2]
    assert runs[0][0] != runs[1][0]


_FINGERPRINT = """
import hashlib, sys
import numpy as np
from gensim2.sim.env import GenSim2Env
env = GenSim2Env("PushDrawerClose", assets="builtin")
if sys.argv[1] == "after others":
    env.reset(seed=11)
    env.step(np.array([0, 0.4, 0, -2, 0, 2.4, 0.7, 1], dtype=np.float32))
env.reset(seed=3)
digest = hashlib.sha256(env.initial_state.objects["drawer"].model.id.encode())
for _ in range(40):
    env.step(np.array([0, 0.45, 0, -2, 0, 2.45, 0.785, 1], dtype=np.float32))
    digest.update(np.asarray(env.get_state()).tobytes())
print("fingerprint", digest.hexdigest())
"""


def test_other_processes_and_earlier_episodes_change_nothing() -> None:
    def fingerprint(case: str) -> str:
        # One in a new interpreter with its own hash seed, one forked.
        words = ["-c", _FINGERPRINT, case]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
        done = (
            subprocess.run([sys.executable, *words], capture_output=True, text=True, timeout=600, env=environment)
            if case == "fresh"
            else warm.run(*words)
        )
        assert done.returncode == 0, done.stderr
        return next(line for line in done.stdout.splitlines() if line.startswith("fingerprint"))

    assert fingerprint("fresh") == fingerprint("after others")


def _draws(name: str, seeds: int, ids: list[str]) -> list[Draw]:
    task = load_task(name)
    (spec,) = task.objects.values()
    return [draw_object(rng(seed, task.name), spec.randomization, preset("paper"), ids) for seed in range(seeds)]


def test_randomization_stays_in_its_ranges_and_fills_them() -> None:
    task = load_task("OpenDrawer")
    draws = _draws("OpenDrawer", 500, [str(n) for n in range(5)])
    ranges = task.objects["drawer"].randomization
    for name, bound in [("x", ranges.x[1]), ("y", ranges.y[1]), ("yaw", ranges.yaw)]:
        values = np.array([getattr(draw, name) for draw in draws])
        assert np.all(np.abs(values) <= bound)
        assert values.min() < -0.9 * bound
        assert values.max() > 0.9 * bound
    assert all(draw.yaw == 0 or np.sign(draw.yaw) == np.sign(draw.y) for draw in draws)
    assert {draw.instance for draw in draws} == {"0", "1", "2", "3", "4"}


def test_what_there_is_to_choose_from_does_not_change_the_rest_of_the_scene() -> None:
    for many, one in zip(_draws("OpenDrawer", 20, ["0", "1", "2"]), _draws("OpenDrawer", 20, ["7"]), strict=True):
        assert (many.x, many.y, many.yaw, many.openness_offset) == (one.x, one.y, one.yaw, one.openness_offset)


def test_reset_options_replace_what_would_be_drawn(crates: Callable[..., Any], crate_task: TaskSpec) -> None:
    env = GenSim2Env(crate_task, assets=crates(2))
    half = np.sqrt(0.5)
    env.reset(seed=0, options={"instance": "1", "openness": 0.9, "pose": [-0.1, 0.05, 0.02, half, 0.0, 0.0, half]})
    assert env.initial_state.objects["crate"].model.id == "1"
    assert env.measure().openness["crate"] == pytest.approx(0.9)
    assert env.parts["crate"].observed()["pose"] == pytest.approx([-0.1, 0.05, 0.02, half, 0.0, 0.0, half], abs=1e-6)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"instanse": "0"}, "instanse: unknown reset option"),
        ({"instance": "99"}, "instance: crate has no instance 99"),
        ({"instance": 0}, "instance: must be the id"),
        ({"openness": 1.5}, "openness: must lie in 0..1"),
        ({"openness": float("nan")}, "openness: must be a finite number"),
        ({"openness": "wide"}, "openness: must be numbers"),
        ({"openness": 10**400}, "openness: must be numbers"),
        ({"offset": [0.0, 0.0]}, "offset: must be 3 finite numbers"),
        ({"pose": [0, 0, 0, 2, 0, 0, 0]}, "pose: the quaternion"),
        ({"pose": [0, 0, 0, 1, 0, 0, 0], "offset": [0, 0, 0]}, "offset: must not be given together"),
    ],
)
def test_bad_reset_options_are_named(
    crates: Callable[..., Any], crate_task: TaskSpec, options: dict[str, Any], expected: str
) -> None:
    env = GenSim2Env(crate_task, assets=crates())
    with pytest.raises(InputError) as caught:
        env.reset(seed=0, options=options)
    assert expected in str(caught.value)
    env.reset(seed=0)  # the environment still works


def _called(name: str) -> dict[str, Any]:
    """Return a task whose only object has this name."""
    done = {"type": "articulated_closed", "object": name}
    step = {"name": "close", "object": name, "strategies": ["push"], "done": [done]}
    return {"name": "Close", "description": "close it", "objects": {name: {"class": "crate"}}, "steps": [step]}


@pytest.mark.parametrize("seed", [-1, 2**32])
def test_seeds_out_of_range_are_named(crates: Callable[..., Any], crate_task: TaskSpec, seed: int) -> None:
    env = GenSim2Env(crate_task, assets=crates())
    with pytest.raises(InputError, match="seed: must lie in 0"):
        env.reset(seed=seed)
    env.reset(seed=2**32 - 1)


@pytest.mark.parametrize(
    ("kwargs", "expected"),
    [
        ({"instances": "7"}, "instance: crate has no instance 7"),
        ({"instances": ()}, "instances: the selection contains no instance"),
        ({"task": "OpenDrawr"}, "did you mean OpenDrawer"),
        ({"task": {"name": "X"}}, "field required"),
        ({"task": _called("panda")}, "objects: no object may have the robot's name 'panda'"),
        ({"instances": {"lid": "0"}}, "instances: there is no object 'lid'"),
        ({"num_envs": 2}, "num_envs"),
        ({"reconfiguration_freq": 0}, "reconfiguration_freq"),
        ({"robot": "baxter"}, "robot: no robot 'baxter'"),
        ({"obs_mode": "pointcloud", "render_backend": "none"}, "render_backend"),
    ],
)
def test_bad_arguments_are_named(
    crates: Callable[..., Any], crate_task: TaskSpec, kwargs: dict[str, Any], expected: str
) -> None:
    with pytest.raises(InputError, match=expected):
        GenSim2Env(**{"task": crate_task, "assets": crates(), **kwargs})


def test_splits_and_lists_limit_what_is_drawn(crates: Callable[..., Any], crate_task: TaskSpec) -> None:
    library = crates(3)
    for instances, expected in [
        ("train", {"0"}),
        ("test", {"1", "2"}),
        ("all", {"0", "1", "2"}),
        (["0", "2"], {"0", "2"}),
    ]:
        env = GenSim2Env(crate_task, assets=library, instances=instances)
        drawn = set()
        for seed in range(12):
            env.reset(seed=seed)
            drawn.add(env.initial_state.objects["crate"].model.id)
        assert drawn == expected


def test_instances_are_chosen_as_the_library_does() -> None:
    library = open_library("builtin")
    for words, expected in [
        ("test", library.split("drawer", "test")),
        (["train", "test"], (*library.split("drawer", "train"), *library.split("drawer", "test"))),
        ("777777", ("777777",)),
        ("all", library.instances("drawer")),
    ]:
        assert GenSim2Env("OpenDrawer", assets=library, instances=words).instance_ids == {"drawer": expected}
    small = load_task("OpenDrawer").model_dump(mode="json")
    small["objects"]["drawer"]["class"] = "toilet"
    with pytest.raises(InputError, match="toilet has only 2 instances, which are all used for training"):
        GenSim2Env(small, assets=library, instances="test")
    env = GenSim2Env("OpenDrawer", assets=library, instances="777777")
    env.reset(seed=0)
    assert env.initial_state.objects["drawer"].model.id == "777777"


def test_openness_and_success_follow_the_joint(crates: Callable[..., Any], crate_task: TaskSpec) -> None:
    env = GenSim2Env(crate_task, assets=crates())
    for openness, success in [(0.3, False), (0.201, False), (0.199, True), (0.0, True)]:
        _, info = env.reset(seed=0, options={"openness": openness})
        assert float(info["openness"]["crate"][0]) == pytest.approx(openness, abs=1e-5)
        assert bool(info["success"][0]) is success


def test_ids_name_their_module_so_that_strangers_can_make_them() -> None:
    task = load_task("OpenBox")
    assert gensim2.sim.env_id(task) == "gensim2.sim:GenSim2-OpenBox-v1"
    changed = parse_task({**task.model_dump(mode="json"), "max_episode_steps": 7})
    assert gensim2.sim.env_id(changed) == "gensim2.sim:GenSim2-Task-v1"
    env = gym.make(gensim2.sim.env_id(changed), task=changed, assets="builtin", instances=("3",))
    spec = env.unwrapped.spec
    assert spec is not None
    assert spec.id == "gensim2.sim:GenSim2-Task-v1"
    assert spec.kwargs["task"]["max_episode_steps"] == 7  # plain data for recorders
    assert spec.kwargs["instances"] == ["3"]
    env.reset(seed=0)
    flags = [bool(env.step(HOLD)[3][0]) for _ in range(7)]
    assert flags == [False] * 6 + [True]


def test_importing_the_registration_does_not_import_maniskill() -> None:
    code = "import gensim2.sim, sys; assert 'mani_skill' not in sys.modules and 'torch' not in sys.modules"
    subprocess.run(
        [sys.executable, "-c", code],
        check=True,
        timeout=600,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
    )


_WITHOUT_DRIVER = """
import numpy as np
from gensim2.core.errors import GenSim2Error, InputError
from gensim2.robots import robot
from gensim2.core.seeding import rng
from gensim2.sim.env import GenSim2Env
env = GenSim2Env(task="OpenDrawer", assets="builtin", render_mode="rgb_array")
env.reset(seed=0)
env.step(np.array([0, -0.3, 0, -2.6, 0, 2.2, 0.78, 1], dtype=np.float32))
for attempt in (env.render, lambda: GenSim2Env(task="OpenDrawer", assets="builtin", obs_mode="pointcloud")):
    try:
        attempt()
    except (GenSim2Error, InputError) as error:
        assert "no Vulkan driver" in str(error), error
    else:
        raise SystemExit("rendered without a driver")
print("physics runs")
"""


def test_physics_runs_where_no_vulkan_driver_is() -> None:
    # In a process that has made no Vulkan instance yet.
    done = warm.run(
        "-c",
        _WITHOUT_DRIVER,
        env=os.environ | {"VK_DRIVER_FILES": "/nonexistent", "VK_ICD_FILENAMES": "/nonexistent"},
    )
    assert done.returncode == 0, done.stderr
    assert "physics runs" in done.stdout


def _can_render() -> bool:
    from gensim2.sim.rendering import can_render

    return can_render()


@pytest.mark.skipif(not _can_render(), reason="no Vulkan driver works on this machine")
def test_point_clouds_show_the_object_and_rendering_changes_no_state() -> None:
    plain = GenSim2Env("OpenDrawer", assets="builtin", obs_mode="none")
    seeing = GenSim2Env("OpenDrawer", assets="builtin", obs_mode="pointcloud", render_mode="rgb_array")
    plain.reset(seed=2)
    obs, _ = seeing.reset(seed=2)
    cloud = obs["pointcloud"]
    points = cloud["xyzw"][0].numpy()
    assert points.shape == (3 * 128 * 128, 4)
    part = seeing.parts["drawer"]
    link = next(link for link in part.articulation.links if link.entity.name == part.model.joint.child_link)
    on_link = cloud["segmentation"][0, :, 0].numpy() == link.entity.per_scene_id
    assert on_link.sum() > 50
    scene = seeing.scene_state()
    thing = scene.objects["drawer"]
    moving = next(body for body in thing.bodies if body.name in thing.joint.moves)
    T_world_link = scene.T_world_base @ moving.T_base_body
    local = (points[on_link, :3] - T_world_link[:3, 3]) @ T_world_link[:3, :3]
    hull = np.concatenate(moving.hulls)
    assert np.all(local > hull.min(axis=0) - 0.02)
    assert np.all(local < hull.max(axis=0) + 0.02)
    image = seeing.render()[0].numpy()
    assert image.shape == (480, 640, 3)
    assert image.std() > 20
    for _ in range(5):
        plain.step(REACH)
        seeing.step(REACH)
    assert _state(plain) == _state(seeing)


def test_rendering_that_was_switched_off_says_so() -> None:
    env = GenSim2Env(task="OpenDrawer", assets="builtin", render_backend="none", render_mode="rgb_array")
    with pytest.raises(GenSim2Error, match=r"switched off|no Vulkan driver"):
        env.render()


def test_seeds_do_not_touch_global_random_state(crates: Callable[..., Any], crate_task: TaskSpec) -> None:
    import torch

    env = GenSim2Env(crate_task, assets=crates())
    np.random.seed(1)  # noqa: NPY002 - tests the global state
    torch.manual_seed(1)
    before = hashlib.sha256(np.random.get_state()[1].tobytes()).hexdigest(), torch.get_rng_state()  # noqa: NPY002
    env.reset(seed=9)
    after = hashlib.sha256(np.random.get_state()[1].tobytes()).hexdigest(), torch.get_rng_state()  # noqa: NPY002
    assert before[0] == after[0]
    assert torch.equal(before[1], after[1])

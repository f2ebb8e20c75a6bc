"""The original's physics in PhysX, and the default physics beside it."""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Callable
from importlib.resources import files
from typing import Any

import numpy as np
import pytest
import sapien
from sapien import physx
from scipy.spatial import ConvexHull

from gensim2.core.errors import InputError
from gensim2.objects import RigidObject, open_library
from gensim2.objects.types import ArticulatedObject, Hulls
from gensim2.robots import robot
from gensim2.scenes.default_pose import DefaultPose, released_pose
from gensim2.sim import original
from gensim2.sim.env import GenSim2Env
from gensim2.sim.headless import HeadlessEnv
from gensim2.sim.physics import DEFAULT, named_physics
from gensim2.sim.rigid import build_rigid
from gensim2.tasks.library import parse_task
from gensim2.tasks.spec import TaskSpec


def task_on(asset_class: str) -> TaskSpec:
    return parse_task(
        {
            "name": "OpenIt",
            "description": "open it",
            "asset_class": asset_class,
            "success": [{"type": "articulated_open", "threshold": 0.8}],
        }
    )


def lane_on(asset_class: str, physics: Any = "original", instance: str = "0") -> HeadlessEnv:
    lane = HeadlessEnv(task_on(asset_class), assets="builtin", instances=instance, physics=physics)
    lane.reset(0)
    return lane


def articulation_in(lane: HeadlessEnv) -> physx.PhysxArticulation:
    (part,) = lane.parts.values()
    articulation: physx.PhysxArticulation = part.articulation
    return articulation


def openness_in(lane: HeadlessEnv) -> float:
    (openness,) = lane.measure().openness.values()
    return openness


# --- scene


def test_scene_settings_are_the_original_s() -> None:
    lane = lane_on("box_rotate")
    config = lane._scene.system.config
    assert config.gravity.tolist() == pytest.approx([0, 0, -9.81])
    assert (config.enable_tgs, config.enable_pcm, config.enable_ccd) == (False, False, False)
    assert config.enable_friction_every_iteration
    assert config.bounce_threshold == 2.0
    assert lane._scene.system.timestep == pytest.approx(0.01)
    for articulation in (articulation_in(lane), lane._robot.articulation):
        assert (articulation.solver_position_iterations, articulation.solver_velocity_iterations) == (10, 1)
        assert articulation.sleep_threshold == pytest.approx(0.005)
        for link in articulation.links:
            for shape in link.collision_shapes:
                assert shape.contact_offset == pytest.approx(0.01)
                material = shape.physical_material
                found = [material.static_friction, material.dynamic_friction, material.restitution]
                assert found == pytest.approx([0.3, 0.3, 0.1])
    (table,) = lane._scene.system.rigid_static_components
    material = table.collision_shapes[0].physical_material
    found = [material.static_friction, material.dynamic_friction, material.restitution]
    assert found == pytest.approx([1.0, 0.2, 0.01])


def test_ours_stays_ours_beside_it() -> None:
    """PhysX's settings and SAPIEN's default material are global, so each scene must set them."""
    lane_on("box_rotate", "original")
    lane = lane_on("box_rotate", "default")
    assert (lane._scene.system.config.enable_tgs, lane._scene.system.config.enable_pcm) == (True, True)
    articulation = articulation_in(lane)
    assert articulation.solver_position_iterations == 15
    robot = lane._robot.articulation
    for link in (*articulation.links, *robot.links):
        for shape in link.collision_shapes:
            assert shape.physical_material.restitution == 0.0
    assert sum(link.mass for link in articulation.links) == pytest.approx(
        lane.initial_state.objects["object"].model.mass, 1e-4
    )
    fingers = [link for link in robot.links if "finger" in link.name and link.collision_shapes]
    assert {shape.physical_material.static_friction for link in fingers for shape in link.collision_shapes} == {2.0}


def test_fingers_are_soft_where_there_is_something_to_pick_up() -> None:
    """Both in the environment and headless; the planner gets it as well."""
    task = "PlaceGolfBallIntoBox"
    lane = HeadlessEnv(task, assets="builtin", physics="original")
    lane.reset(0)
    env = GenSim2Env(task, assets="builtin", physics="original")
    env.reset(seed=0)
    for robot_there in (lane._robot.articulation, env.unwrapped.agent.robot._objs[0]):
        fingers = [joint for joint in robot_there.active_joints if "finger" in joint.name]
        assert {(joint.stiffness, joint.damping) for joint in fingers} == {(100.0, 1.0)}
    assert lane.scene_state().finger_stiffness == env.unwrapped.scene_state().finger_stiffness == 100.0
    assert lane_on("box_rotate").scene_state().finger_stiffness == 1000.0


# --- objects


@pytest.mark.parametrize(
    ("asset_class", "density", "coefficient"),
    [
        ("faucet", 7800, 0.01),
        ("bucket_swing", 7800, 0.05),
        ("toaster_press", 10, 1e8),
        ("box_rotate", 100, 0.25),
        ("suitcase_rotate", 100, 0.25),
        ("laptop_rotate", 100, 0.4),
        ("dishwasher", 100, 0.4),
        ("drawer", 100, 0.1),
    ],
)
def test_masses_and_friction_are_those_of_the_class(asset_class: str, density: float, coefficient: float) -> None:
    lane = lane_on(asset_class)
    model = lane.initial_state.objects["object"].model
    assert isinstance(model, ArticulatedObject)
    articulation = articulation_in(lane)
    for link in articulation.links:
        volume = sum(ConvexHull(hull).volume for hull in model.hulls[link.name])
        assert link.mass == pytest.approx(density * volume, rel=0.02)  # of PhysX's cooked hulls
        assert np.linalg.eigvalsh(np.diag(link.inertia)).min() > 0
    (joint,) = articulation.active_joints
    assert joint.friction == pytest.approx(coefficient)
    assert (joint.stiffness, joint.damping) == (0.0, 0.0)


def test_a_class_that_the_original_has_not_takes_its_usual_values() -> None:
    constants = original.constants()
    assert (constants.density("desk_lamp"), constants.joint_friction("desk_lamp")) == (100.0, 0.1)


@pytest.mark.parametrize(("physics", "density"), [("original", 100.0), ("default", None)])
def test_rigid_objects_weigh_by_their_hulls(physics: str, density: float | None) -> None:
    rigid = open_library("builtin").load("golf_ball", "0")
    assert isinstance(rigid, RigidObject)
    how = named_physics(physics)
    scene = sapien.Scene([how.new_system(robot("panda"))])
    entity = build_rigid(scene, rigid, sapien.Pose([0, 0, 1]), "ball", how)
    body = entity.find_component_by_type(physx.PhysxRigidDynamicComponent)
    volume = sum(ConvexHull(hull).volume for hull in rigid.hulls["body"])
    expected = rigid.mass if density is None else density * volume
    assert body.mass == pytest.approx(expected, rel=0.01)
    friction, restitution = (0.3, 0.1) if density else (rigid.friction, 0.0)
    for shape in body.collision_shapes:
        assert shape.physical_material.static_friction == pytest.approx(friction)
        assert shape.physical_material.restitution == pytest.approx(restitution)


def _left_alone(lane: HeadlessEnv, openness: float, seconds: float = 5.0) -> float:
    lane.reset(0, {"openness": openness}, robot=False)
    for _ in range(round(seconds * 20)):
        lane.wait()
    return float(lane.measure().openness["object"])


@pytest.mark.parametrize(
    ("asset_class", "end"),
    [("oven", 1.0), ("kitchen_pot", 0.0), ("box_rotate", 0.5)],
)
def test_what_is_left_half_open_falls_under_the_original_and_stays_under_ours(asset_class: str, end: float) -> None:
    """An oven door and a pot lid fall, a box lid stays: as in SAPIEN 2.2.2 (benchmarks/left_alone.py)."""
    assert _left_alone(lane_on(asset_class, "original"), 0.5) == pytest.approx(end, abs=0.02)
    assert _left_alone(lane_on(asset_class, "default"), 0.5) == pytest.approx(0.5, abs=0.01)


def test_a_toaster_s_lever_stays_up_and_yields_to_a_push() -> None:
    """With the original's friction coefficient of 1e8."""
    lane = lane_on("toaster_press")
    assert _left_alone(lane, 0.3, 1.0) == pytest.approx(0.3, abs=0.01)
    lane.reset(0, {"openness": 0.3}, robot=False)
    part = lane.parts["object"]
    lever = part.keypoints()["articulated_object_head"]
    builder = lane._scene.scene.create_actor_builder()
    builder.add_box_collision(half_size=[0.01, 0.01, 0.01])
    builder.set_initial_pose(sapien.Pose([lever[0], lever[1], lever[2] + 0.03]))
    block = builder.build(name="block").find_component_by_type(physx.PhysxRigidDynamicComponent)
    block.disable_gravity = True
    block.linear_damping = block.angular_damping = 60.0
    for _ in range(100):
        block.add_force_at_point([0.0, 0.0, -1.0], block.entity.pose.p)
        lane._scene.system.step()
    assert lane.measure().openness["object"] > 0.6


# --- default poses


def test_every_row_is_a_pose_and_none_stands_twice() -> None:
    text = (files("gensim2.scenes") / "default_poses.csv").read_text()
    box = dataclasses.replace(open_library("builtin").load("box_rotate", "0"), source="real")
    assert isinstance(box, ArticulatedObject)
    rows = list(csv.DictReader(text.splitlines()))
    assert len(rows) == len({(row["class"], row["id"]) for row in rows}) == 169
    for row in rows:
        pose = released_pose(dataclasses.replace(box, asset_class=row["class"], id=row["id"]))
        assert pose is not None
        assert np.linalg.norm(pose.quaternion) == pytest.approx(1.0)
        assert np.abs(pose.position).max() < 0.65
        assert 0 <= pose.openness <= 1
    assert released_pose(dataclasses.replace(box, id="no such box")) is None
    assert released_pose(dataclasses.replace(box, id="100141", source="generated")) is None


class _Renamed:
    """The built-in box 0 with the name of a released model."""

    def __init__(self, instance: ArticulatedObject) -> None:
        self._instance = instance

    def source(self, asset_class: str, /) -> str:
        return "real"

    def instances(self, asset_class: str, /) -> tuple[str, ...]:
        return (self._instance.id,)

    def choose(self, asset_class: str, which: str, /) -> tuple[str, ...]:
        return (self._instance.id,)

    def load(self, asset_class: str, instance_id: str, hulls: Hulls = "default", /) -> ArticulatedObject:
        return self._instance


def test_a_released_model_stands_at_the_original_s_pose_and_others_at_ours() -> None:
    generated = lane_on("box_rotate").initial_state.objects["object"].model
    assert isinstance(generated, ArticulatedObject)
    released = dataclasses.replace(generated, source="real", id="100141")
    unknown = dataclasses.replace(generated, source="real", id="1")
    still = {"offset": [0.0, 0.0, 0.0]}
    row = released_pose(released)
    assert row is not None
    own = generated.placement.position
    cases: list[tuple[Any, ArticulatedObject, Any, str]] = [
        ("original", released, row.position, "original"),
        ("default", released, own, "default"),
        ("original", unknown, own, "default"),
        ("original", generated, own, "default"),
    ]
    for physics, model, position, origin in cases:
        lane = HeadlessEnv(task_on("box_rotate"), assets=_Renamed(model), physics=physics)
        lane.reset(0, still)
        thing = lane.initial_state.objects["object"]
        assert thing.position == pytest.approx(position)
        assert thing.default_pose == origin
        assert articulation_in(lane).pose.p == pytest.approx(position, abs=1e-6)
    lane.reset(0, {"pose": [0.0, 0.0, 0.2, 1.0, 0.0, 0.0, 0.0]})
    assert lane.initial_state.objects["object"].default_pose is None


def test_a_pose_that_has_what_moves_in_the_table_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    """If it is 1 cm in the table, SAPIEN 3 keeps a toaster in place, while SAPIEN 2 lets it slide."""
    generated = lane_on("toaster_move").initial_state.objects["object"].model
    assert isinstance(generated, ArticulatedObject)
    place = generated.placement
    sunk = DefaultPose(place.position - [0.0, 0.0, 0.01], place.quaternion, 0.0, "original")
    monkeypatch.setattr("gensim2.scenes.default_pose.released_pose", lambda _: sunk)
    lane = HeadlessEnv(
        task_on("toaster_move"), assets=_Renamed(dataclasses.replace(generated, source="real")), physics="original"
    )
    lane.reset(0, {"offset": [0.0, 0.0, 0.0], "openness": 0.0}, robot=False)
    thing = lane.initial_state.objects["object"]
    assert thing.default_pose == "original"
    assert thing.position == pytest.approx(place.position, abs=1e-4)
    toaster = articulation_in(lane).links[-1]
    for _ in range(100):
        toaster.add_force_at_point([5.0, 0.0, 0.0], (toaster.entity.pose * toaster.cmass_local_pose).p)
        lane._scene.system.step()
    assert openness_in(lane) > 0.8


# --- environment and headless


@pytest.mark.parametrize("damping", [0.0, 0.05])
@pytest.mark.parametrize("physics", ["default", "original"])
def test_states_are_those_of_the_environment(
    crates: Callable[..., Any], crate_task: TaskSpec, physics: Any, damping: float
) -> None:
    library = crates(damping=damping, friction=0.35)
    env = GenSim2Env(crate_task, assets=library, physics=physics)
    lane = HeadlessEnv(crate_task, assets=library, physics=physics)
    options = {"offset": [-0.02, 0.0, 0.0], "openness": 0.9}
    start = np.array([0.0, -0.32, 0.0, -2.618, 0.0, 2.23, 0.785, 1.0], dtype=np.float32)
    reach = np.array([0.0, 0.9, 0.0, -1.9, 0.0, 2.7, 0.785, -1.0], dtype=np.float32)
    rng = np.random.default_rng(3)
    moved = []
    for seed in range(3):
        env.reset(seed=seed, options=dict(options))
        lane.reset(seed, options)
        before = openness_in(lane)
        for share in np.linspace(0.0, 1.0, 40):
            action = (1 - share) * start + share * reach + rng.normal(0.0, 0.02, 8).astype(np.float32)
            env.step(action)
            lane.step(action)
            assert np.array_equal(env.get_obs()[0].numpy(), lane.observation())
        states = env.get_state_dict()["articulations"]
        for part, state in lane.state()["articulations"].items():
            assert np.array_equal(states[part][0].numpy(), state)
        moved.append(abs(openness_in(lane) - before))
    assert max(moved) > 0.05


def test_an_unknown_physics_is_refused(crate_task: TaskSpec, crates: Callable[..., Any]) -> None:
    for make in (HeadlessEnv, GenSim2Env):
        with pytest.raises(InputError, match="physics: no physics 'theirs' \\(one of default, original\\)"):
            make(crate_task, assets=crates(), physics="theirs")
    assert named_physics("default") is named_physics("ours") is DEFAULT

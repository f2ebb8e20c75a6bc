"""Ray casting compared with exact results: shapes with a formula for the depth, and link poses of the simulator."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from gensim2.core.errors import InputError
from gensim2.perception import Camera, ObservationSpec
from gensim2.perception.observation import tool_pose
from gensim2.perception.raycast.caster import Caster, CastSolid
from gensim2.perception.raycast.observer import Observer
from gensim2.perception.raycast.scene import RaycastScene
from gensim2.perception.raycast.shapes import Surface, read_mesh
from gensim2.robots import load_robot, robot
from gensim2.sim.env import GenSim2Env
from gensim2.sim.headless import HeadlessEnv
from gensim2.sim.rendering import can_render

HOLD = np.array([0, -0.32, 0, -2.618, 0, 2.23, 0.785, 1], dtype=np.float32)
FAR_AWAY = np.array([[1.0, 0, 0, 50.0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])

PACKAGED = ("panda", "fetch")
#: Boxes and cylinders, with passive hinges.
OWN = tuple(load_robot(Path(__file__).parents[2] / "examples" / "robots" / f"{name}.py") for name in ("ur5e", "xarm7"))


def camera(eye: tuple[float, float, float] = (0.0, -2.0, 0.5), name: str = "a") -> Camera:
    return Camera.looking(name, eye, (0.0, 0.0, 0.3), width=80, height=60, fov=0.9)


def ball(radius: float) -> Surface:
    shape = trimesh.creation.icosphere(5, radius)
    colors = np.full((len(shape.faces), 3), (200, 10, 20), dtype=np.uint8)
    return Surface(shape.vertices.astype(np.float32), shape.faces.astype(np.int32), colors)


def at(x: float, y: float, z: float, yaw: float = 0.0) -> np.ndarray:
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    pose[:3, 3] = x, y, z
    return pose


def states(lane: HeadlessEnv) -> dict[str, Any]:
    """Return the present state as recordings contain it."""
    return {kind: {name: row[None] for name, row in rows.items()} for kind, rows in lane.state().items()}


def models(lane: HeadlessEnv) -> dict[str, Any]:
    return {name: placed.model for name, placed in lane.initial_state.objects.items()}


def test_a_ball_and_a_box_are_met_where_geometry_says() -> None:
    cameras = (camera(), camera((1.5, -1.0, 0.9), "b"))
    solids = [
        CastSolid(4, Surface.box((0, 0, 0), (0.2, 0.3, 0.1), (1, 2, 3)), still=True),
        CastSolid(7, ball(0.25), still=False),
    ]
    poses = np.stack([at(0.3, 0.4, 0.1, 0.5), at(-0.2, 0.0, 0.4)])
    caster = Caster(solids, cameras)
    hits = caster.cast(poses)
    for number, seen in enumerate(cameras):
        rays, eye = seen.rays.reshape(-1, 3).astype(float), seen.position.astype(float)
        t_ball = _sphere(eye, rays, poses[1][:3, 3], 0.25)
        t_box = _box(eye, rays, poses[0], np.array([0.2, 0.3, 0.1]))
        truth = np.minimum(np.minimum(t_ball, t_box), seen.far)
        ids = np.where(truth == seen.far, 0, np.where(t_ball < t_box, 7, 4))
        found, segmentation = hits.depth[number].reshape(-1), caster.segmentation(hits.face[number]).reshape(-1)
        same = ids == segmentation
        assert same.mean() > 0.998, "a ball of triangles is a little smaller than a ball"
        inner = same & (ids > 0)
        assert {4, 7} <= set(ids[inner].tolist())
        assert np.abs(found - truth)[inner & (ids == 4)].max() < 1e-5
        assert np.quantile(np.abs(found - truth)[inner & (ids == 7)], 0.98) < 2e-3
        flat = [
            hits.face[number].reshape(-1)[inner],
            np.zeros(inner.sum(), np.float32),
            np.zeros(inner.sum(), np.float32),
        ]
        expected = np.where((ids[inner] == 7)[:, None], (200, 10, 20), (1, 2, 3))
        assert np.array_equal(caster.colors(*flat), expected)


def _sphere(eye: np.ndarray, rays: np.ndarray, center: np.ndarray, radius: float) -> np.ndarray:
    a, b = (rays**2).sum(axis=1), rays @ (eye - center)
    root = b**2 - a * ((eye - center) @ (eye - center) - radius**2)
    return np.where(root > 0, (-b - np.sqrt(root.clip(0))) / a, np.inf)


def _box(eye: np.ndarray, rays: np.ndarray, pose: np.ndarray, half: np.ndarray) -> np.ndarray:
    start, way = (eye - pose[:3, 3]) @ pose[:3, :3], rays @ pose[:3, :3]
    sides = np.stack([(-half - start) / way, (half - start) / way])
    near, far = sides.min(axis=0).max(axis=1), sides.max(axis=0).min(axis=1)
    return np.where((near <= far) & (far > 0), near, np.inf)


def test_what_was_cast_before_changes_nothing() -> None:
    """Images of static objects are cached; if such an object moves, it is cast again."""
    solids = [CastSolid(1, ball(0.3), still=True), CastSolid(2, ball(0.2), still=False)]
    kept = Caster(solids, [camera()])
    for poses in (np.stack([at(0, 0, 0.3), at(0.1, -0.4, 0.3)]), np.stack([at(0.2, 0, 0.3), FAR_AWAY])):
        kept.cast(poses)
        mine, fresh = kept.cast(poses), Caster(solids, [camera()]).cast(poses)
        assert np.array_equal(mine.depth[0], fresh.depth[0])
        assert np.array_equal(mine.face[0], fresh.face[0])


def test_a_thing_around_and_behind_the_camera_is_seen_and_not_seen() -> None:
    seen = camera()
    around = Caster([CastSolid(1, ball(5.0), still=True)], [seen]).cast(np.stack([at(*seen.position.tolist())]))
    assert (around.face[0] >= 0).all()
    behind = Caster([CastSolid(1, ball(0.5), still=True)], [seen]).cast(np.stack([at(0.0, -4.0, 0.7)]))
    assert (behind.face[0] < 0).all()


def test_a_texture_is_sampled_where_it_lies(tmp_path: Path) -> None:
    picture = np.zeros((2, 2, 3), dtype=np.uint8)
    picture[0, 0], picture[0, 1], picture[1, 0], picture[1, 1] = (255, 0, 0), (0, 255, 0), (0, 0, 255), (9, 9, 9)
    corners = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]], dtype=np.float64)
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=Image.fromarray(picture))
    looks = trimesh.visual.TextureVisuals(uv=(corners[:, [0, 2]] + 1) / 2, material=material)
    trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], visual=looks, process=False).export(tmp_path / "board.glb")
    surface = read_mesh(tmp_path / "board.glb")
    assert surface is not None
    seen = Camera.looking("a", (0, -3, 0), (0, 0, 0), width=40, height=40, fov=0.5)
    caster = Caster([CastSolid(1, surface, still=True)], [seen])
    hits = caster.cast(np.eye(4)[None])
    colors = caster.colors(hits.face[0], hits.u[0], hits.v[0])
    assert (hits.face[0] >= 0).all()
    for (row, column), texel in {(5, 5): (0, 0), (5, 35): (0, 1), (35, 5): (1, 0), (35, 35): (1, 1)}.items():
        assert tuple(colors[row, column]) == tuple(picture[texel])


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.glb", b"glTF\x02"),
        ("a.dae", b"<"),
        ("a.ply", b"ply\nformat"),
        ("a.obj", b"v 0 0 0\nf 1 1 9\n"),
    ],
)
def test_a_mesh_that_is_damaged_or_no_file_is_one_error(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=name):
        read_mesh(tmp_path / name)
    (tmp_path / name).unlink()
    os.mkfifo(tmp_path / name)
    with pytest.raises(InputError, match="is a pipe"):
        read_mesh(tmp_path / name)


def test_what_a_mesh_names_is_no_pipe(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    os.mkfifo(tmp_path / "a.mtl")
    with contextlib.suppress(InputError):
        read_mesh(tmp_path / "a.obj")


@pytest.mark.parametrize("name", [*PACKAGED, *OWN], ids=lambda name: Path(name).stem)
def test_links_and_ids_are_the_simulators(name: str) -> None:
    lane = HeadlessEnv("StashCupInBox" if name == "panda" else "OpenDrawer", assets="builtin", robot=name)
    lane.reset(seed=4)
    for _ in range(3):
        lane.step(lane.profile.rest_action + np.float32(0.2))
    profile = robot(name)
    scene = RaycastScene(profile, models(lane), [camera()])
    poses = scene.poses(states(lane))[0]
    entities = {entity.per_scene_id: entity for entity in lane._scene.scene.entities}
    assert set(scene.names) == set(entities), "every link and body has the id that the simulator gave it"
    seen = [solid.id for solid in scene._solids]
    for id, pose in zip(seen, poses, strict=True):
        owner, link = scene.names[id]
        assert owner == "table" or entities[id].name in (link, f"scene-0_{link}", owner)
        truth = entities[id].pose.to_transformation_matrix()
        assert np.abs(profile.T_world_base @ pose - truth).max() < 5e-6, (owner, link)
    hand = {scene.names[id][1] for id in scene.robot.gripper}
    assert profile.hand_link in hand
    assert set(profile.gripper.pads) <= hand
    tool = next(link for link in lane._robot.articulation.links if link.entity.name == profile.tool_link)
    expected = np.concatenate([tool.entity.pose.p - profile.base_position, tool.entity.pose.q])
    found = tool_pose(profile, lane.q.astype(np.float32))
    assert np.abs(found[:3] - expected[:3]).max() < 5e-6
    assert abs(abs(found[3:] @ expected[3:]) - 1) < 1e-6


def test_settings_are_for_rays_and_states_are_of_the_scene() -> None:
    with pytest.raises(InputError, match="observation"):
        GenSim2Env("OpenDrawer", assets="builtin", obs_mode="state", observation={"points": 8})
    with pytest.raises(InputError, match="no setting 'colour'"):
        GenSim2Env("OpenDrawer", assets="builtin", obs_mode="raycast", observation={"colour": 8})
    lane = HeadlessEnv("OpenDrawer", assets="builtin")
    lane.reset(seed=1)
    scene = RaycastScene(robot("panda"), models(lane), [camera()])
    with pytest.raises(InputError, match="env_states/articulations/drawer"):
        scene.poses({"articulations": {"panda": states(lane)["articulations"]["panda"]}})
    with pytest.raises(InputError, match=r"must have the shape \(T, 31\)"):
        scene.poses({"articulations": {"panda": np.zeros((2, 30)), "drawer": np.zeros((2, 15))}})


@pytest.mark.skipif(not can_render(), reason="no Vulkan driver works on this machine")
def test_pictures_are_those_of_the_renderer() -> None:
    from gensim2.scenes.config import SceneOptions
    from gensim2.sim.pictures import StatePictures
    from gensim2.tasks.library import load_task

    lane = HeadlessEnv("StashCupInBox", assets="builtin")
    lane.reset(seed=6)
    for _ in range(6):
        lane.step(HOLD + np.float32(0.4))
    recorded = states(lane)
    pictures = StatePictures(SceneOptions("builtin").with_task(lane.task), ("depth", "segmentation"))
    instances = {name: model.id for name, model in models(lane).items()}
    pictures.show(instances, 6, {"instance": instances})
    images = pictures.at(recorded, 0)
    pictures.close()
    observer = Observer(robot("panda"), models(lane), ObservationSpec(), seed=6)
    assert load_task("StashCupInBox") == lane.task
    for view in observer.views(observer.scene.poses(recorded)[0], 0):
        theirs = images[view.camera.name]
        same = theirs["segmentation"] == view.segmentation
        assert same.mean() > 0.999
        assert len(np.unique(theirs["segmentation"])) > 8
        apart = np.abs(theirs["depth"] / 1000 - view.depth)[same & (theirs["segmentation"] > 0)]
        assert (apart < 0.002).mean() > 0.999

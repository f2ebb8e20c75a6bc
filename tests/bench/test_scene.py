"""Scene geometry of a problem: parts, roles and missing meshes, compared with an independent reader."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gensim2.bench.problems import PlanProblem
from gensim2.bench.scene import ProblemScene, check_assets, convex_points, load_parts, problem_scene
from gensim2.core.errors import InputError

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n"


def scene_of(problem: dict[str, Any], assets: Path) -> ProblemScene:
    T_base_hand = np.eye(4)
    T_base_hand[:3, 3] = [0.4, 0.0, 0.35]
    return problem_scene(PlanProblem.model_validate(problem), assets, T_base_hand)


def test_parts_are_what_triangles_connect(tmp_path: Path) -> None:
    path = tmp_path / "two.obj"
    path.write_text(SQUARE + "v 5 0 0\nv 6 0 0\nv 6 1 2\nf -3 -2 -1\n")
    parts = load_parts(path.parent, path.name).vertices
    assert sorted(len(part) for part in parts) == [3, 4]


def test_vertices_at_one_place_are_one(tmp_path: Path) -> None:
    path = tmp_path / "soup.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1/1 2/2 3/3\nf 4//1 5//1 6//1\n")
    assert [len(part) for part in load_parts(path.parent, path.name).vertices] == [4]


@pytest.mark.parametrize(
    "text", ["v 0 0\nf 1 1 1\n", "v a b c\n", SQUARE + "f 1 2 9\n", SQUARE + "f 0 1 2\n", SQUARE + "v nan 0 0\n"]
)
def test_broken_meshes_are_named(tmp_path: Path, text: str) -> None:
    path = tmp_path / "broken.obj"
    path.write_text(text)
    with pytest.raises(InputError, match=r"broken\.obj"):
        load_parts(path.parent, path.name)


def test_flat_parts_get_a_thickness() -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    thick = convex_points(corners)
    assert thick is not None
    np.testing.assert_allclose(np.sort(np.ptp(thick, axis=0)), [5e-4, 1.0, 1.0])
    assert convex_points(corners[:2]) is None
    assert convex_points(np.outer(np.arange(5.0), [1.0, 2.0, 3.0])) is None


def test_roles_and_joint(problem: dict[str, Any], assets: Path) -> None:
    scene = scene_of(problem, assets)
    assert [(each.role, len(each.hulls)) for each in scene.obstacles] == [
        ("table", 1),
        ("object_body", 1),
        ("moving_link", 1),
    ]
    assert scene.joint is not None
    np.testing.assert_allclose(scene.joint.origin, np.asarray(problem["T_base_object"])[:3, 3], atol=1e-12)
    np.testing.assert_allclose(scene.joint.axis, [0, 0, 1], atol=1e-12)
    assert (scene.joint.lower, scene.joint.upper) == (0.0, 1.5)


def test_a_missing_mesh_is_a_warning(problem: dict[str, Any], assets: Path, tmp_path: Path) -> None:
    shutil.copytree(assets, tmp_path / "assets")
    (tmp_path / "assets/articulated_objs/cabinet/1/textured_objs/door.obj").unlink()
    scene = scene_of(problem, tmp_path / "assets")
    assert scene.warnings == ("missing mesh: textured_objs/door.obj",)
    assert [each.role for each in scene.obstacles] == ["table", "object_body"]


def test_missing_folders_are_errors(problem: dict[str, Any], assets: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="articulated_objs"):
        check_assets(tmp_path)
    problem["objects"]["articulated"]["id"] = "2"
    with pytest.raises(InputError, match=r"mobility\.urdf"):
        scene_of(problem, assets)


@pytest.mark.parametrize(
    ("fingers", "offset", "target", "role"),
    [
        (0.02, 0.01, "articulated_object_head", "attached"),
        (0.04, 0.01, "rigidbody_object_head", "target"),
        (0.02, 0.2, "articulated_object_head", "rigid"),
    ],
)
def test_rigid_objects(
    problem: dict[str, Any], assets: Path, fingers: float, offset: float, target: str, role: str
) -> None:
    folder = assets / "rigidbody_objs" / "models" / "cube"
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(assets / "articulated_objs/cabinet/1/textured_objs/body.obj", folder / "collision.obj")
    world = np.asarray(problem["T_world_base"])[:3, 3]
    place = world + np.array([0.4, offset, 0.35 + problem["tool_keypoints_hand"]["tool_head"][2]])
    problem["objects"]["rigid"] = {"cls": "cube", "p": place.tolist(), "q": [1.0, 0.0, 0.0, 0.0], "scale": 0.04}
    problem["q_current"][7:] = [fingers, fingers]
    problem["config"]["constraint_list"][0]["target_keypoint_name"] = target
    assert scene_of(problem, assets).obstacles[-1].role == role


@pytest.mark.usefixtures("peers")
def test_agrees_with_pinocchio_and_trimesh(problem: dict[str, Any], assets: Path) -> None:
    import peers

    for angle in (0.0, 0.6, 1.4):
        problem["objects"]["articulated"]["qpos"] = [angle]
        ours = scene_of(problem, assets)
        theirs, missing = peers.scene_obstacles(json.loads(json.dumps(problem)), assets, np.eye(4))
        assert missing == []
        assert [each.role for each in theirs] == [each.role for each in ours.obstacles]
        for one, two in zip(ours.obstacles, theirs, strict=True):
            points = np.concatenate(one.hulls) @ one.pose[:3, :3].T + one.pose[:3, 3]
            theirs_at = np.concatenate([each.points for each in two.parts]) @ two.pose[:3, :3].T + two.pose[:3, 3]
            np.testing.assert_allclose(points.min(axis=0), theirs_at.min(axis=0), atol=1e-9)
            np.testing.assert_allclose(points.max(axis=0), theirs_at.max(axis=0), atol=1e-9)

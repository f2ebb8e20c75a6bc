"""Rigid objects: sizes and masses of the YCB set, rest in physics, grasps for a Panda, three sources."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh

from gensim2.core.errors import InputError
from gensim2.inspection.rigid import physical_findings
from gensim2.objects import Library, open_library
from gensim2.objects.library.rigid import CLASSES
from gensim2.objects.library.rigid_prepare import best_grip, read, resting_pose, resting_sides, steadiness
from gensim2.objects.physics import Inertial
from gensim2.objects.types import AssetError

# Published with the YCB set (Calli et al., 2015): mass in g, extents in mm in increasing order.
YCB = {
    "apple": (68, (75, 75, 75)),
    "banana": (66, (36, 90, 190)),
    "bowl": (147, (53, 159, 159)),
    "cracker_box": (411, (60, 160, 230)),
    "gelatin_box": (97, (28, 73, 85)),
    "golf_ball": (46, (42.7, 42.7, 42.7)),
    "lemon": (29, (54, 54, 68)),
    "marker": (15.8, (18, 18, 121)),
    "master_chef_can": (414, (102, 102, 139)),
    "mustard_bottle": (603, (58, 95, 190)),
    "potted_meat_can": (370, (50, 82, 97)),
    "softball": (191, (96, 96, 96)),
    "sugar_box": (514, (38, 89, 175)),
    "tomato_soup_can": (349, (66, 66, 101)),
    "tuna_fish_can": (171, (33, 85, 85)),
    "wood_block": (729, (85, 85, 200)),
}


def test_forty_objects_by_the_names_that_people_know(library: Library) -> None:
    names = library.classes("rigid")
    assert len(names) >= 40
    assert {"apple", "lemon", "mug", "cracker_box", "golf_ball", "softball", "gold_bar", "marker", "bowl"} <= set(names)


@pytest.mark.parametrize("name", YCB)
def test_masses_and_sizes_are_those_of_the_real_things(library: Library, name: str) -> None:
    mass, size = YCB[name]
    scale = CLASSES[name].scale
    loaded = library.load_rigid(name)
    assert loaded.mass == pytest.approx(mass / 1000 * scale**3, rel=0.02)
    np.testing.assert_allclose(np.sort(loaded.size), np.array(size) / 1000 * scale, rtol=0.2)


def test_generation_gives_the_same_object_again(
    library: Library, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = library.load_rigid("mug")
    monkeypatch.setenv("GENSIM2_CACHE", str(tmp_path))
    second = open_library("builtin").load_rigid("mug")
    assert first.folder != second.folder
    for file in ("visual.glb", "hull_0.obj", "rigid.json"):
        assert (first.folder / file).read_bytes() == (second.folder / file).read_bytes()


def box(x: float, y: float, z: float) -> np.ndarray:
    """Return the corners (8, 3) of a box around the origin."""
    return np.array([[a * x, b * y, c * z] for a in (-0.5, 0.5) for b in (-0.5, 0.5) for c in (-0.5, 0.5)])


def test_a_box_stands_until_its_centre_leaves_its_foot() -> None:
    assert steadiness(box(0.04, 0.1, 0.2), np.zeros(3)) == pytest.approx(np.arctan2(0.02, 0.1))
    assert steadiness(box(0.04, 0.1, 0.2), np.array([0.03, 0, 0])) < 0


def test_what_cannot_stand_is_laid_on_its_largest_side() -> None:
    mass = Inertial(0.1, np.zeros(3), np.eye(3))
    standing = resting_pose([box(0.06, 0.1, 0.2)], mass)
    np.testing.assert_allclose(standing.rotation, np.eye(3), atol=1e-9)
    assert standing.position[2] == pytest.approx(0.1)
    lying = resting_pose([box(0.01, 0.1, 0.2)], mass)
    np.testing.assert_allclose(np.abs(lying.rotation[2]), [1, 0, 0], atol=1e-9)
    assert lying.position[2] == pytest.approx(0.005)


def test_sides_are_ordered_by_the_chance_to_land_and_topple_on_them() -> None:
    sides = resting_sides(box(0.02, 0.05, 0.1), np.zeros(3))
    np.testing.assert_allclose(np.abs(sides), np.repeat(np.eye(3), 2, axis=0), atol=1e-9)
    # A leaning body topples from its ends, where its centre of mass is beyond an edge, onto its large sides.
    slanted = box(0.1, 0.1, 0.1) + np.array([0.2, 0, 0]) * (box(1, 1, 1)[:, 2:] + 0.5)
    np.testing.assert_allclose(np.abs(resting_sides(slanted, slanted.mean(axis=0)))[:, 1], [0, 0, 1, 1], atol=1e-9)


def test_a_box_is_held_across_its_narrow_side() -> None:
    hulls = [box(0.03, 0.07, 0.1)]
    grip = best_grip(hulls, np.zeros(3), resting_pose(hulls, Inertial(0.1, np.zeros(3), np.eye(3))))
    assert grip.width == pytest.approx(0.03)
    np.testing.assert_allclose(np.abs(grip.axis), [1, 0, 0], atol=1e-9)
    np.testing.assert_allclose(grip.point, np.zeros(3), atol=1e-9)


def test_a_mug_is_held_by_its_wall_or_handle(library: Library) -> None:
    assert library.load_rigid("mug").grip.width < 0.02


def write_ycb(folder: Path) -> Path:
    """Write a folder like that of ManiSkill's YCB download, with one small box."""
    model = folder / "models" / "004_sugar_box"
    model.mkdir(parents=True)
    mesh = trimesh.creation.box((0.04, 0.09, 0.17))
    mesh.export(model / "collision.ply")
    mesh.export(model / "textured.obj")
    entry = {"bbox": {"min": [-0.02, -0.045, -0.085], "max": [0.02, 0.045, 0.085]}, "scales": [0.8], "density": 700}
    (folder / "info_pick_v0.json").write_text(json.dumps({"004_sugar_box": entry, "005_not_there": entry}))
    return folder


def test_maniskill_ycb_download_is_read(library: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MS_ASSET_DIR", str(tmp_path))
    with pytest.raises(InputError, match="download_asset ycb"):
        open_library("ycb")
    write_ycb(tmp_path / "data" / "assets" / "mani_skill2_ycb")
    found = open_library("ycb")
    assert found.classes("articulated") == ()
    assert [c for c in found.classes() if found.source(c) == "real"] == ["004_sugar_box"]
    loaded = found.load_rigid("004_sugar_box")
    np.testing.assert_allclose(loaded.size, [0.032, 0.072, 0.136], atol=1e-6)
    assert loaded.mass == pytest.approx(0.514 * 0.8**3)
    np.testing.assert_allclose(loaded.keypoints["rigidbody_object_head"].position, [0, 0, 0.068], atol=1e-9)
    assert physical_findings(loaded) == []


def test_released_layout_is_read(library: object, tmp_path: Path) -> None:
    model = tmp_path / "rigidbody_objs" / "models" / "brick"
    model.mkdir(parents=True)
    trimesh.creation.box((0.05, 0.07, 0.05)).export(model / "collision.obj")
    info = {"scale": 0.5, "keypoints": {"rigidbody_object_head": [0, 0, 0.025]}}
    (model / "info.json").write_text(json.dumps(info))
    opened = open_library(tmp_path)
    loaded = opened.load_rigid("brick")
    assert loaded.source == "real"
    assert loaded.visual is None
    assert "there is no visual mesh" in loaded.warnings[0]
    np.testing.assert_allclose(loaded.size, [0.025, 0.035, 0.025], atol=1e-6)
    np.testing.assert_allclose(loaded.keypoints["rigidbody_object_head"].position, [0, 0, 0.0125])
    (model / "info.json").write_text(json.dumps({**info, "scale": -1}))
    with pytest.raises(AssetError, match="scale"):
        open_library(tmp_path).load_rigid("brick")


@pytest.mark.parametrize(("unit", "natural"), [(1.0, True), (0.01, False), (0.001, False)])
def test_a_known_object_in_another_unit_than_metres_has_the_mass_of_its_size(
    library: object, tmp_path: Path, unit: float, natural: bool
) -> None:
    model = tmp_path / "rigidbody_objs" / "models" / "mug"
    model.mkdir(parents=True)
    trimesh.creation.box(np.array([0.08, 0.08, 0.1]) / unit).export(model / "collision.obj")
    (model / "info.json").write_text(json.dumps({"scale": unit, "keypoints": {"rigidbody_object_head": [0, 0, 0]}}))
    loaded = open_library(tmp_path).load_rigid("mug")
    assert 0.05 < loaded.mass < 2.0
    assert (loaded.mass == pytest.approx(CLASSES["mug"].mass)) is natural


def test_unknown_names_and_damage_are_told(library: Library, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="mug"):
        library.load_rigid("mugg")
    copy = tmp_path / "copy"
    shutil.copytree(library.load_rigid("apple").folder, copy)
    (copy / "rigid.json").write_text("{}")
    with pytest.raises(AssetError, match="damaged"):
        read(copy)

"""Exported objects are read back unchanged by our reader and by other libraries."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from gensim2.core.errors import InputError
from gensim2.objects import ArticulatedObject, Library, open_library
from gensim2.objects.library.export import export


def same_hulls(a: ArticulatedObject, b: ArticulatedObject) -> None:
    """Check that both have the same convex parts, in any order of their vertices."""
    assert list(a.hulls) == list(b.hulls)
    for link, hulls in a.hulls.items():
        assert len(hulls) == len(b.hulls[link])
        for one, two in zip(hulls, b.hulls[link], strict=True):
            first, second = ConvexHull(one), ConvexHull(two)
            assert first.volume == pytest.approx(second.volume, rel=1e-6)
            outside = second.points @ first.equations[:, :3].T + first.equations[:, 3]
            assert outside.max() < 1e-7


def same_object(a: ArticulatedObject, b: ArticulatedObject) -> None:
    assert (a.asset_class, a.id, a.object_axis, a.license) == (b.asset_class, b.id, b.object_axis, b.license)
    assert (a.joint.name, a.joint.type, a.joint.child_link) == (b.joint.name, b.joint.type, b.joint.child_link)
    for name in ("origin", "axis", "T_root_child"):
        np.testing.assert_allclose(getattr(a.joint, name), getattr(b.joint, name), atol=1e-8)
    for name in ("lower", "upper", "friction", "damping"):
        assert getattr(a.joint, name) == pytest.approx(getattr(b.joint, name), rel=1e-5, abs=1e-9)
    assert a.keypoints.keys() == b.keypoints.keys()
    for name, keypoint in a.keypoints.items():
        other = b.keypoints[name]
        assert (keypoint.link, keypoint.description) == (other.link, other.description)
        np.testing.assert_allclose(keypoint.position, other.position, atol=1e-8)
    np.testing.assert_allclose(a.T_link_object, b.T_link_object, atol=1e-8)
    np.testing.assert_allclose(a.placement.position, b.placement.position, atol=2e-6)
    assert a.mass == pytest.approx(b.mass, rel=1e-5)
    same_hulls(a, b)


@pytest.mark.parametrize("name", ["drawer", "bucket_swing", "laptop_rotate", "bottle_cap", "toaster_press"])
def test_generated_object_comes_back_as_it_was(library: Library, tmp_path: Path, name: str) -> None:
    instance = library.load(name, "1")
    folder = export(instance, tmp_path)
    assert folder == tmp_path / "articulated_objs" / name / "1"
    again = open_library(tmp_path).load(name, "1")
    assert again.warnings == ()
    same_object(instance, again)


def test_export_of_an_export_is_the_same_again(library: Library, tmp_path: Path) -> None:
    first = export(library.load("safe_rotate", "2"), tmp_path / "one")
    second = export(open_library(tmp_path / "one").load("safe_rotate", "2"), tmp_path / "two")
    assert (first / "info.json").read_text() == (second / "info.json").read_text()


def test_scaled_real_object_comes_back_as_it_was(
    chest: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GENSIM2_CACHE", str(tmp_path / "cache"))
    chest(tmp_path / "lib" / "box_rotate" / "1")
    instance = open_library(tmp_path / "lib").load("box_rotate", "1")
    export(instance, tmp_path / "out")
    same_object(instance, open_library(tmp_path / "out").load("box_rotate", "1"))


@pytest.mark.parametrize("name", ["drawer", "faucet"])
def test_pinocchio_sees_the_same_joint_and_masses(library: Library, tmp_path: Path, name: str) -> None:
    pinocchio = pytest.importorskip("pinocchio")
    instance = library.load(name, "0")
    model = pinocchio.buildModelFromUrdf(str(export(instance, tmp_path) / "mobility.urdf"))
    assert (model.nq, list(model.names)[1:]) == (1, [instance.joint.name])
    np.testing.assert_allclose(model.lowerPositionLimit, [instance.joint.lower], atol=1e-7)
    np.testing.assert_allclose(model.upperPositionLimit, [instance.joint.upper], atol=1e-7)
    assert sum(inertia.mass for inertia in model.inertias) == pytest.approx(instance.mass, rel=1e-6)
    np.testing.assert_allclose(model.jointPlacements[1].homogeneous, instance.joint.T_root_child, atol=1e-7)


def test_sapien_builds_every_part(library: Library, tmp_path: Path) -> None:
    sapien = pytest.importorskip("sapien")
    instance = library.load("microwave", "0")
    loader = sapien.Scene([sapien.physx.PhysxCpuSystem()]).create_urdf_loader()
    builder = loader.parse(str(export(instance, tmp_path) / "mobility.urdf"))[0][0]
    for link in builder.link_builders:
        link.visual_records.clear()
    built = builder.build(fix_root_link=True)
    assert {link.name: len(link.collision_shapes) for link in built.links} == {
        link: len(hulls) for link, hulls in instance.hulls.items()
    }


def test_what_is_seen_comes_along(library: Library, tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    instance = library.load("drawer", "4")
    folder = export(instance, tmp_path)
    for link in instance.hulls:
        ours = trimesh.load(instance.urdf.parent / "visual" / f"{link}.glb", force="mesh")
        theirs = trimesh.load(folder / "textured_objs" / f"{link}_visual.obj", force="mesh")
        assert theirs.area == pytest.approx(ours.area, rel=1e-4)
        np.testing.assert_allclose(theirs.bounds, ours.bounds, atol=1e-6)


def test_an_object_that_is_there_is_not_overwritten(library: Library, tmp_path: Path) -> None:
    instance = library.load("drawer", "1")
    folder = export(instance, tmp_path)
    (folder / "info.json").write_text("mine")
    with pytest.raises(InputError, match=r"drawer/1: already exists .*--force"):
        export(instance, tmp_path)
    assert (folder / "info.json").read_text() == "mine"
    export(instance, tmp_path, replace=True)
    assert (folder / "info.json").read_text().startswith("{")
    assert [p.name for p in folder.parent.iterdir()] == ["1"]


@pytest.mark.parametrize(
    ("collision", "message"),
    [("concave", "collision: the value 'concave' is not supported"), ("convex", "has no volume")],
)
def test_declared_parts_must_be_what_they_are_said_to_be(
    chest: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, collision: str, message: str
) -> None:
    monkeypatch.setenv("GENSIM2_CACHE", str(tmp_path / "cache"))
    folder = chest(tmp_path / "lib" / "box_rotate" / "1", collision=collision)
    (folder / "textured_objs" / "left.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(InputError, match=message):
        open_library(tmp_path / "lib").load("box_rotate", "1")

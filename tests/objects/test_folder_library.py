"""The reader of the released format, on objects written here."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gensim2.inspection.checks import clearance_of, geometric_findings
from gensim2.objects import ArticulatedObject, AssetError, open_library
from gensim2.objects.meshwork.convexes import ConvexBlock, depth_inside

Load = Callable[..., ArticulatedObject]


@pytest.fixture
def load(chest: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Load:
    """Write a chest with changed ``info.json`` fields and load it."""
    monkeypatch.setenv("GENSIM2_CACHE", str(tmp_path / "cache"))

    def write_and_load(change: Callable[[Path], object] = lambda folder: None, **info: object) -> ArticulatedObject:
        folder = chest(tmp_path / "assets" / "articulated_objs" / "box_rotate" / "1", **info)
        change(folder)
        return open_library(tmp_path / "assets").load("box_rotate", "1")

    return write_and_load


def test_scale_keypoints_and_frames(load: Load) -> None:
    instance = load()
    assert instance.source == "real"
    assert instance.warnings == ()
    assert (instance.joint.lower, instance.joint.upper) == (0.0, 1.5)
    # model (x, y, z) is root (-z, -x, y); the hinge is at model (0, 0.2, -0.4), times the scale
    np.testing.assert_allclose(instance.joint.origin, [0.1, 0, 0.05], atol=1e-12)
    np.testing.assert_allclose(instance.joint.axis, [0, 1, 0], atol=1e-12)
    head = instance.keypoints["articulated_object_head"]
    assert head.link == "link_0"
    np.testing.assert_allclose(head.position, 0.25 * np.array([0, 0.05, 0.8]), atol=1e-12)
    assert instance.keypoints["articulated_object_inside_base"].link == "base"
    np.testing.assert_allclose(instance.keypoints["articulated_object_inside_base"].position, [-0.025, 0, 0.1])
    np.testing.assert_allclose(instance.T_link_object[:3, 3], [0, -0.05, 0.1])
    assert instance.lever_arm("articulated_object_head") == pytest.approx(0.25 * np.hypot(0.05, 0.8))
    assert geometric_findings(instance) == []


def test_cavity_stays_open_and_walls_stay_solid(load: Load) -> None:
    instance = load()
    blocks = [ConvexBlock.of(h) for h in instance.hulls["base"]]
    assert len(blocks) == 5
    wall = np.array([[0.0875 + 0.006, 0.0, 0.0]])
    assert depth_inside(np.zeros((1, 3)), blocks)[0] == 0.0
    assert depth_inside(wall, blocks)[0] > 0.0


def test_range_that_is_disjoint_from_the_limits_holds_and_is_noted(load: Load) -> None:
    instance = load(joint_position_range=[-1.5, -0.2])
    assert (instance.joint.lower, instance.joint.upper) == (-1.5, -0.2)
    assert any("does not overlap" in w for w in instance.warnings)


def test_missing_scale_and_colour_names_have_a_stated_rule(load: Load) -> None:
    instance = load(
        scale=None, keypoints={"blue": [0, 0, 5], "red": [0, 0.25, 0.4], "green": [3, 0, 0]}, keypoint_descriptions=None
    )
    assert any("no scale: 0.25" in w for w in instance.warnings)
    assert any("'red', 0 mm from the moving link" in w for w in instance.warnings)
    assert list(instance.keypoints) == ["articulated_object_head"]


def test_missing_mesh_is_counted(load: Load) -> None:
    instance = load(lambda folder: (folder / "textured_objs" / "left.obj").unlink())
    assert instance.warnings == ("1 mesh files missing: textured_objs/left.obj",)
    assert len(instance.hulls["base"]) == 4


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("info.json", "{", r"info\.json: not JSON"),
        ("info.json", '{"keypoints": {}}', r"info\.json: keypoints: no keypoints"),
        ("info.json", '{"keypoints": {"a": [0, NaN, 1]}, "scale": 1}', r"keypoints\.a: not three finite numbers"),
        ("info.json", '{"keypoints": {"a": [0, 1, 1]}, "scale": -1}', r"scale: must be a positive number"),
        ("info.json", '{"keypoints": {"a": [0, 1, 1]}, "scale": 1, "axis": "w"}', r"axis: 'w' is not x, y or z"),
        (
            "info.json",
            '{"keypoints": {"a": [0, 1, 1]}, "scale": 1, "joint_position_range": [1, 1]}',
            r"joint_position_range: must be two increasing numbers",
        ),
        ("mobility.urdf", "<robot>", r"mobility\.urdf: not XML"),
        ("mobility.urdf", "<robot><link name='base'/></robot>", r"has 0 movable joints instead of one"),
    ],
)
def test_what_cannot_be_used_names_file_and_field(load: Load, file: str, text: str, message: str) -> None:
    with pytest.raises(AssetError, match=message):
        load(lambda folder: (folder / file).write_text(text))


@pytest.mark.parametrize("name", ["../left.obj", "/left.obj", "textured_objs/../../left.obj"])
def test_meshes_outside_the_folder_are_refused(load: Load, name: str) -> None:
    def point_outside(folder: Path) -> None:
        urdf = folder / "mobility.urdf"
        urdf.write_text(urdf.read_text().replace("textured_objs/left.obj", name))

    with pytest.raises(AssetError, match=r"mobility\.urdf: link link_1: visual: .*left\.obj lies outside the folder"):
        load(point_outside)


def test_two_joints_are_refused(load: Load) -> None:
    def free_the_other(folder: Path) -> None:
        urdf = folder / "mobility.urdf"
        urdf.write_text(urdf.read_text().replace('type="fixed"', 'type="revolute"'))

    with pytest.raises(AssetError, match=r"2 movable joints.*fix all joints but one"):
        load(free_the_other)


def test_broken_mesh_is_counted(load: Load) -> None:
    instance = load(lambda folder: (folder / "textured_objs" / "left.obj").write_text("v 1 2 x\n"))
    assert "1 mesh files unreadable: textured_objs/left.obj" in instance.warnings[0]


def test_a_colour_that_is_no_number_is_counted(load: Load) -> None:
    instance = load(lambda folder: (folder / "textured_objs" / "left.mtl").write_text("newmtl paint\nKd 0.2 nan 0.1\n"))
    assert "left.mtl: material paint has a colour that is not a number" in instance.warnings[0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"scale": 1e3}, r"info\.json: scale: the largest value of the geometry is 800"),
        ({"joint_position_range": [0, 1e6]}, r"joint_position_range: the largest value of the joint is 1e\+06"),
    ],
)
def test_what_no_table_holds_is_refused(load: Load, change: dict[str, object], message: str) -> None:
    with pytest.raises(AssetError, match=message):
        load(**change)


@pytest.mark.parametrize(
    ("height", "clearance", "findings"),
    [
        (0.0, 62.5, []),  # the floor is 0.25 units below, the walls are farther away, the lid is open
        (-0.22, 7.5, ["clearance of articulated_object_inside_base when open, mm"]),
        (-0.27, -5.0, ["clearance of articulated_object_inside_base when open, mm"]),
    ],
)
def test_clearance_is_that_of_the_open_object(load: Load, height: float, clearance: float, findings: list[str]) -> None:
    inside = "articulated_object_inside_base"
    instance = load(keypoints={"articulated_object_head": [0.0, 0.25, 0.4], inside: [0.0, 0.0, height]})
    assert 1000 * clearance_of(instance, inside) == pytest.approx(clearance, abs=1.0)
    assert [finding.check for finding in geometric_findings(instance)] == findings

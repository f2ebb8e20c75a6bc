"""A plain PartNet-Mobility folder with two joints becomes a validated object."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gensim2.cli import main as cli
from gensim2.core.errors import InputError
from gensim2.inspection.checks import geometric_findings
from gensim2.inspection.validate import check_object
from gensim2.objects import AssetError, open_library
from gensim2.objects.library.folder import ObjectFolder, find_source
from gensim2.objects.library.importer import import_object, usual_size
from gensim2.objects.library.meshes import MeshReader
from gensim2.objects.library.released import LICENSE, license_of
from gensim2.objects.library.transfer import on_surface
from gensim2.objects.library.urdf import read_urdf, shape_elements
from gensim2.objects.shapes import Look, Mesh, transform

BOARDS = {
    "floor": ((-0.6, -0.5, -0.4), (0.6, -0.45, 0.4)),
    "left": ((-0.6, -0.45, -0.4), (-0.55, 0.3, 0.4)),
    "right": ((0.55, -0.45, -0.4), (0.6, 0.3, 0.4)),
    "back": ((-0.55, -0.45, -0.4), (0.55, 0.3, -0.35)),
    "front": ((-0.55, -0.1, 0.35), (0.55, 0.3, 0.4)),
    "shelf": ((-0.55, -0.1, -0.35), (0.55, -0.05, 0.35)),
}
LID = {"lid": ((-0.6, 0.31, -0.4), (0.6, 0.36, 0.4)), "knob": ((-0.05, 0.31, 0.4), (0.05, 0.36, 0.44))}
TRAY = {
    "tray_front": ((-0.53, -0.43, 0.36), (0.53, -0.12, 0.41)),
    "tray_floor": ((-0.53, -0.43, -0.3), (0.53, -0.40, 0.36)),
    "grip": ((-0.1, -0.3, 0.41), (0.1, -0.25, 0.47)),
}
HINGE = np.array([0.0, 0.31, -0.4])


@pytest.fixture
def partnet(tmp_path: Path, cube: Callable[..., None], monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cabinet in PartNet-Mobility's format: a hinged lid (joint_0), a sliding tray (joint_1), and no size."""
    monkeypatch.setenv("GENSIM2_CACHE", str(tmp_path / "cache"))
    folder = tmp_path / "45001"
    (folder / "textured_objs").mkdir(parents=True)

    def link(name: str, boxes: dict[str, Any], origin: Any = (0, 0, 0)) -> str:
        for part, (low, high) in boxes.items():
            cube(folder / "textured_objs", part, low, high)
        place = f'<origin xyz="{" ".join(str(-v) for v in origin)}"/>'
        shapes = [
            f'<{kind} name="{"handle-7" if part in ("knob", "grip") else "board-1"}">{place}<geometry>'
            f'<mesh filename="textured_objs/{part}.obj"/></geometry></{kind}>'
            for part in boxes
            for kind in ("visual", "collision")
        ]
        return f'<link name="{name}">{"".join(shapes)}</link>'

    (folder / "mobility.urdf").write_text(
        '<?xml version="1.0" ?><robot name="partnet_45001"><link name="base"/>'
        + link("link_0", LID, HINGE)
        + link("link_1", TRAY)
        + link("link_2", BOARDS)
        + f'<joint name="joint_0" type="revolute"><origin xyz="{" ".join(map(str, HINGE))}"/><axis xyz="-1 0 0"/>'
        '<child link="link_0"/><parent link="link_2"/><limit lower="0" upper="1.5"/></joint>'
        '<joint name="joint_1" type="prismatic"><origin xyz="0 0 0"/><axis xyz="0 0 1"/>'
        '<child link="link_1"/><parent link="link_2"/><limit lower="0" upper="0.6"/></joint>'
        '<joint name="joint_2" type="fixed"><origin rpy="1.570796326794897 0 -1.570796326794897" xyz="0 0 0"/>'
        '<child link="link_2"/><parent link="base"/></joint></robot>'
    )
    (folder / "semantics.txt").write_text(
        "link_0 hinge rotation_lid\nlink_1 slider drawer\nlink_2 heavy furniture_body\n"
    )
    (folder / "meta.json").write_text('{"model_cat": "StorageFurniture", "model_id": "x"}')
    return folder


def change(folder: Path, old: str, new: str) -> None:
    file = folder / "mobility.urdf"
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))


def test_command_makes_a_sound_object_of_two_joints(
    partnet: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("sapien")
    out = tmp_path / "mine"
    words = ["assets", "import", str(partnet), "--class", "drawer", "--name", "45001", "--out", str(out)]
    assert cli.run([*words, "--json", "-"]) == 0
    result = json.loads(capfd.readouterr().out)
    assert (result["joint"], result["fixed"]) == ("joint_1", ["joint_0"])
    assert result["object"] == {"class": "drawer", "id": "45001", "sound": True, "findings": []}
    assert any("joint_1 stays movable: it is the only prismatic joint" in note for note in result["notes"])
    assert cli.run(words) == 2
    assert "already exists" in capfd.readouterr().err
    assert cli.run([*words, "--force"]) == 0
    assert "ok     drawer/45001" in capfd.readouterr().out
    assert cli.run(["assets", "validate", "--assets", str(out), "--workers", "1", "--no-physics"]) == 0


@pytest.mark.parametrize(("asset_class", "joint"), [("drawer", "joint_1"), ("box_rotate", "joint_0")])
def test_size_joint_and_keypoints(partnet: Path, tmp_path: Path, asset_class: str, joint: str) -> None:
    done = import_object(partnet, tmp_path / "lib", asset_class, "a")
    assert done.joint == joint
    instance = open_library(tmp_path / "lib").load(asset_class, "a")
    assert instance.warnings == ()
    assert geometric_findings(instance) == []
    points = np.concatenate([h for hulls in instance.hulls.values() for h in hulls])
    # the longest side of the model is 1.2 units
    assert done.scale * 1.2 == pytest.approx(usual_size(asset_class), rel=1e-3)
    assert points[:, 1].max() - points[:, 1].min() == pytest.approx(1.2 * done.scale, rel=0.2)
    head = transform(instance.link_pose(0.0), instance.keypoints["articulated_object_head"].position[None])[0]
    # model (x, y, z) is root (-z, -x, y)
    part = TRAY["grip"] if joint == "joint_1" else LID["knob"]
    middle = done.scale * np.mean(part, axis=0)
    np.testing.assert_allclose(head, [-middle[2], -middle[0], middle[1]], atol=done.scale * 0.04)
    assert "handle of the" in instance.keypoints["articulated_object_head"].description
    if joint == "joint_1":
        assert instance.joint.upper == pytest.approx(0.6 * done.scale)
        np.testing.assert_allclose(instance.joint.axis, [-1, 0, 0], atol=1e-9)
    else:
        assert instance.joint.upper == pytest.approx(1.5)
        tail = instance.lever_arm("articulated_object_tail")
        assert tail < 0.3 * instance.lever_arm("articulated_object_head")


def test_what_is_pushed_is_touched_from_behind(partnet: Path, tmp_path: Path) -> None:
    change(partnet, 'name="handle-7"', 'name="board-7"')
    pulled, pushed = (
        json.loads((import_object(partnet, tmp_path / "lib", c, "a", joint="joint_1").folder / "info.json").read_text())
        for c in ("drawer", "box_move")
    )
    for one, other in (("head", "tail"), ("tail", "head")):
        assert pulled["keypoints"][f"articulated_object_{one}"] == pushed["keypoints"][f"articulated_object_{other}"]
    assert pulled["keypoints"]["articulated_object_head"][2] == 0.47
    assert "leads" in pulled["keypoint_descriptions"]["articulated_object_head"]
    assert "trails" in pushed["keypoint_descriptions"]["articulated_object_head"]


def test_what_the_user_edits_counts(partnet: Path, tmp_path: Path) -> None:
    file = import_object(partnet, tmp_path / "lib", "drawer", "a", scale=0.2).folder / "info.json"
    info = json.loads(file.read_text())
    assert info["imported"]["fixed"] == ["joint_0"]
    info["keypoints"]["articulated_object_inside"] = [0.0, -0.3, 0.0]
    info["joint_position_range"][1] = 0.05
    file.write_text(json.dumps(info))
    instance = open_library(tmp_path / "lib").load("drawer", "a")
    assert instance.joint.upper == 0.05
    np.testing.assert_allclose(instance.keypoints["articulated_object_inside"].position, [0, -0.06, 0], atol=1e-9)


def test_the_user_chooses_where_several_joints_could_be_meant(partnet: Path, tmp_path: Path) -> None:
    with pytest.raises(
        AssetError,
        match=r"has 2 movable joints, .*\(choose one of these joints with --joint: joint_0 \(revolute, rot.*drawer",
    ):
        import_object(partnet, tmp_path / "lib", "furniture", "a")
    with pytest.raises(AssetError, match="no movable joint 'joint_2'"):
        import_object(partnet, tmp_path / "lib", "furniture", "a", joint="joint_2")
    assert not (tmp_path / "lib").exists()
    done = import_object(partnet, tmp_path / "lib", "furniture", "a", joint="joint_0")
    assert done.fixed == ("joint_1",)
    assert done.scale == 0.25
    assert check_object(open_library(tmp_path / "lib"), "furniture", "a", physics=False).sound


def test_joints_are_fixed_where_they_rest(partnet: Path, tmp_path: Path) -> None:
    change(partnet, 'lower="0" upper="0.6"', 'lower="0.1" upper="0.6"')
    done = import_object(partnet, tmp_path / "lib", "box_rotate", "a")
    joints = {j.get("name"): j for j in ET.parse(done.folder / "mobility.urdf").getroot().findall("joint")}
    origin = joints["joint_1"].find("origin")
    assert joints["joint_1"].get("type") == "fixed"
    assert origin is not None
    assert origin.get("xyz") == "0 0 0.1"
    limit = joints["joint_0"].find("limit")
    assert limit is not None
    assert {"effort", "velocity"} <= set(limit.attrib)


def test_a_joint_that_opens_downwards_is_turned_around(partnet: Path, tmp_path: Path) -> None:
    whole = import_object(partnet, tmp_path / "one", "box_rotate", "a")
    change(partnet, 'axis xyz="-1 0 0"', 'axis xyz="1 0 0"')
    change(partnet, 'lower="0" upper="1.5"', 'lower="-1.5" upper="0"')
    done = import_object(partnet, tmp_path / "two", "box_rotate", "a")
    assert any("is reversed" in note for note in done.notes)
    assert not any("is reversed" in note for note in whole.notes)
    one, two = (open_library(tmp_path / where).load("box_rotate", "a") for where in ("one", "two"))
    np.testing.assert_allclose(one.link_pose(0.7), two.link_pose(0.7), atol=1e-9)


def test_a_continuous_joint_gets_a_range(partnet: Path, tmp_path: Path) -> None:
    change(partnet, 'type="revolute"', 'type="continuous"')
    change(partnet, '<limit lower="0" upper="1.5"/>', "")
    done = import_object(partnet, tmp_path / "lib", "box_rotate", "a")
    assert any("0 to 90 degrees" in note for note in done.notes)
    joint = open_library(tmp_path / "lib").load("box_rotate", "a").joint
    assert (joint.lower, joint.upper) == (0.0, pytest.approx(np.pi / 2))


def test_a_quaternion_turns_the_object_like_roll_pitch_and_yaw(partnet: Path, tmp_path: Path) -> None:
    import_object(partnet, tmp_path / "lib", "drawer", "a")
    change(partnet, 'rpy="1.570796326794897 0 -1.570796326794897"', 'quat_xyzw="0.5 -0.5 -0.5 0.5"')
    import_object(partnet, tmp_path / "lib", "drawer", "b")
    one, other = (open_library(tmp_path / "lib").load("drawer", name).joint for name in "ab")
    np.testing.assert_allclose(one.axis, other.axis, atol=1e-9)
    np.testing.assert_allclose(one.origin, other.origin, atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("textured_objs/", "package://cabinet/textured_objs/"),
        ("textured_objs/", "file://textured_objs/"),
        ("textured_objs/", "textured_objs\\"),
        ("textured_objs/", "package://cabinet\\textured_objs\\"),
    ],
)
def test_mesh_names_of_other_tools_are_resolved(partnet: Path, tmp_path: Path, old: str, new: str) -> None:
    expected = import_object(partnet, tmp_path / "lib", "drawer", "a").scale
    change(partnet, old, new)
    done = import_object(partnet, tmp_path / "lib", "drawer", "b")
    assert done.scale == expected
    assert not any("missing" in note for note in done.notes)
    assert {path.name for path in done.folder.glob("textured_objs/*.obj")} == {
        path.name for path in partnet.glob("textured_objs/*.obj")
    }


@pytest.mark.parametrize("name", ["package://gone/lid.obj", "file:///gone/lid.obj", "gone\\lid.obj"])
def test_a_mesh_that_is_not_found_is_named(partnet: Path, tmp_path: Path, name: str) -> None:
    change(partnet, "textured_objs/lid.obj", name)
    change(partnet, "textured_objs/knob.obj", name)
    with pytest.raises(AssetError, match=r"lid\.obj"):
        import_object(partnet, tmp_path / "lib", "box_rotate", "a")


@pytest.mark.parametrize(
    ("shape", "extent"),
    [
        ('<box size="1.2 0.05 0.8"/>', (1.2, 0.05, 0.8)),
        ('<cylinder radius="0.4" length="0.1"/>', (0.8, 0.8, 0.1)),
        ('<sphere radius="0.3"/>', (0.6, 0.6, 0.6)),
        ('<capsule radius="0.1" length="0.4"/>', (0.2, 0.2, 0.6)),
    ],
)
def test_shapes_without_a_file_are_taken(partnet: Path, tmp_path: Path, shape: str, extent: tuple[float, ...]) -> None:
    change(partnet, '<mesh filename="textured_objs/lid.obj"/>', shape)
    change(partnet, '<mesh filename="textured_objs/knob.obj"/>', shape)
    folder = ObjectFolder(import_object(partnet, tmp_path / "lib", "box_rotate", "a").folder)
    for kind in ("visual", "collision"):
        for element in shape_elements(read_urdf(folder), "link_0", kind):
            (mesh,) = MeshReader(folder).get(element, 1.0, np.eye(4))
            np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), extent, rtol=0.01)


def test_an_object_of_boxes_loads(partnet: Path, tmp_path: Path) -> None:
    for name, (low, high) in {**BOARDS, **LID, **TRAY}.items():
        size, middle = np.subtract(high, low), np.mean([low, high], axis=0)
        if name in LID:
            middle = middle - HINGE
        place = f'xyz="{" ".join(map(str, middle))}"'
        text = (partnet / "mobility.urdf").read_text()
        mesh = f'<mesh filename="textured_objs/{name}.obj"/>'
        for old in re.findall(rf'<origin xyz="[^"]*"/><geometry>{mesh}', text):
            text = text.replace(old, f'<origin {place}/><geometry><box size="{" ".join(map(str, size))}"/>')
        (partnet / "mobility.urdf").write_text(text)
    done = import_object(partnet, tmp_path / "lib", "box_rotate", "a")
    instance = open_library(tmp_path / "lib").load("box_rotate", "a")
    moving = np.concatenate(instance.hulls[instance.joint.child_link])
    extent = np.ptp([*LID["lid"], *LID["knob"]], axis=0)
    np.testing.assert_allclose(np.ptp(moving, axis=0), done.scale * extent, atol=2e-3)


def test_terms_are_the_makers(partnet: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    import_object(partnet, tmp_path / "lib", "drawer", "a")
    import_object(partnet, tmp_path / "lib", "drawer", "b", license="CC BY 4.0")
    library = open_library(tmp_path / "lib")
    assert [library.load("drawer", name).license for name in "ab"] == ["unstated", "CC BY 4.0"]
    for file in (tmp_path / "lib").rglob("info.json"):
        info = json.loads(file.read_text())
        del info["license"]
        file.write_text(json.dumps(info))
        assert license_of(ObjectFolder(file.parent)) == LICENSE  # a released class with PartNet's meta.json
        (file.parent / "meta.json").unlink()
        assert license_of(ObjectFolder(file.parent)) == "unstated"
    words = ["assets", "import", str(partnet), "--class", "drawer", "--name", "c", "--out", str(tmp_path / "lib")]
    assert cli.run([*words, "--license", " "]) == 2
    assert "license: ' ' is not a licence text" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('type="prismatic"', 'type="floating"', "unsupported type 'floating'"),
        ("textured_objs/lid.obj", "../../lid.obj", "lies outside the folder"),
        ('lower="0" upper="1.5"', 'lower="1" upper="1"', "joint_0: limit: empty range"),
        ("</robot>", "", "not XML"),
    ],
)
def test_what_cannot_be_used_is_refused(partnet: Path, tmp_path: Path, old: str, new: str, message: str) -> None:
    change(partnet, old, new)
    with pytest.raises(AssetError, match=message):
        import_object(partnet, tmp_path / "lib", "box_rotate", "a", joint="joint_0")


def test_names_and_scales_are_checked(partnet: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match=r"name: '\.\./a' is not a valid folder name"):
        import_object(partnet, tmp_path / "lib", "box_rotate", "../a")
    words = ["assets", "import", str(partnet), "--class", "box_rotate", "--name", "a", "--out", str(tmp_path / "lib")]
    assert cli.run([*words, "--scale", "-1"]) == 2
    assert "neither 'auto' nor a positive number" in capfd.readouterr().err


def test_downloads_of_maniskill_are_found_by_number(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MS_ASSET_DIR", str(tmp_path))
    folder = tmp_path / "data" / "partnet_mobility" / "dataset" / "1000"
    folder.mkdir(parents=True)
    assert find_source("1000") == folder
    assert find_source(str(tmp_path)) == tmp_path
    with pytest.raises(InputError, match="partnet_mobility"):
        find_source("1001")


def test_on_surface_is_the_nearest_point() -> None:
    triangle = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]), Look())
    np.testing.assert_allclose(on_surface(np.array([0.2, 0.2, 0.7]), [triangle]), [0.2, 0.2, 0])
    np.testing.assert_allclose(on_surface(np.array([-1.0, -1, 0]), [triangle]), [0, 0, 0])


PRIMITIVES = """<robot name="cabinet">
  <link name="body">{body}</link>
  <link name="door">{door}</link>
  <joint name="hinge" type="revolute"><parent link="body"/><child link="door"/>
    <origin xyz="-0.1 0 0.11"/><axis xyz="0 -1 0"/><limit lower="0" upper="1.5" effort="5" velocity="2"/></joint>
</robot>"""


@pytest.fixture
def cabinet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A URDF file of primitives: y points up, the door is at z, and its handle is a cylinder with a ball."""
    monkeypatch.setenv("GENSIM2_CACHE", str(tmp_path / "cache"))

    def shape(geometry: str, xyz: str) -> str:
        both = (
            f'<{tag}><origin xyz="{xyz}"/><geometry>{geometry}</geometry></{tag}>' for tag in ("visual", "collision")
        )
        return "".join(both)

    body = shape('<box size="0.2 0.02 0.2"/>', "0 -0.1 0") + shape('<box size="0.2 0.14 0.02"/>', "0 -0.02 -0.09")
    door = shape('<box size="0.2 0.16 0.01"/>', "0.1 0 0") + shape(
        '<cylinder radius="0.008" length="0.04"/>', "0.17 0 0.02"
    )
    door += shape('<sphere radius="0.012"/>', "0.17 0.05 0.02")
    file = tmp_path / "models" / "cabinet.urdf"
    file.parent.mkdir()
    (file.parent / "images").mkdir()
    (file.parent / "images" / "holiday.png").write_bytes(b"")
    file.write_text(PRIMITIVES.format(body=body, door=door))
    return file


def test_a_urdf_file_whose_y_axis_points_up_stands_upright(cabinet: Path, tmp_path: Path) -> None:
    points = {"head": (0.17, 0.05, 0.032), "base_corner": (0.1, -0.09, 0.1)}
    done = import_object(cabinet, tmp_path / "lib", "my_door", "1", scale=2.0, up="y", keypoints=points)
    assert sorted(path.name for path in done.folder.iterdir()) == ["info.json", "mobility.urdf", "textured_objs"]
    instance = open_library(tmp_path / "lib").load_articulated("my_door", "1")
    np.testing.assert_allclose(instance.joint.axis, [0, 0, -1], atol=1e-7)
    np.testing.assert_allclose(instance.joint.origin, [-0.22, 0.2, 0], atol=1e-7)
    corner, head = (instance.keypoints[f"articulated_object_{name}"] for name in ("base_corner", "head"))
    np.testing.assert_allclose(corner.position, [-0.2, -0.2, -0.18], atol=1e-7)
    np.testing.assert_allclose(head.position, [0.34, 0.1, 0.064], atol=1e-7)
    assert (corner.link, head.link) == ("base", instance.joint.child_link)
    assert "articulated_object_tail" in instance.keypoints, "proposed, as before"
    upright = import_object(cabinet, tmp_path / "lib", "my_door", "2", scale=2.0)
    assert upright.folder.name == "2"
    np.testing.assert_allclose(
        open_library(tmp_path / "lib").load_articulated("my_door", "2").joint.axis, [0, -1, 0], atol=1e-7
    )


def test_the_command_draws_the_keypoints_that_were_given(
    cabinet: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    from PIL import Image

    (tmp_path / "points.yaml").write_text("tail: [0.01, 0.0, 0.005]\n")
    words = ["assets", "import", str(cabinet), "--class", "my_door", "--name", "1", "--out", str(tmp_path / "lib")]
    given = [
        "--up",
        "y",
        "--scale",
        "1",
        "--keypoint",
        "head=0.17,0.05,0.032",
        "--keypoint",
        str(tmp_path / "points.yaml"),
    ]
    assert cli.run([*words, *given]) == 0
    assert f"picture: {tmp_path / 'lib' / 'pictures' / 'my_door_1.png'}" in capfd.readouterr().out
    info = json.loads((tmp_path / "lib" / "articulated_objs" / "my_door" / "1" / "info.json").read_text())
    assert info["keypoints"] == {
        "articulated_object_head": [0.07, 0.05, 0.032],
        "articulated_object_tail": [-0.09, 0, 0.005],
    }
    picture = np.asarray(Image.open(tmp_path / "lib" / "pictures" / "my_door_1.png").convert("RGB")).astype(int)
    for column, color in ((0, (214, 39, 58)), (1, (214, 39, 58))):
        view = picture[26:, 364 * column : 364 * column + 360]
        assert (np.abs(view - color).sum(axis=-1) < 30).sum() > 20, "the disc of the head"


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ("head=1,2", "keypoint 'head': \\[1.0, 2.0\\] is not a list of three numbers"),
        ("head=1,2,nan", "keypoint 'head': .* is not a list of three numbers"),
        ("head=1,2,x", "does not contain three numbers"),
        ("../head=1,2,3", "this is not a valid name of a keypoint"),
        ("nowhere.yaml", "nowhere.yaml"),
    ],
)
def test_keypoints_that_cannot_be_are_refused(
    cabinet: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], option: str, message: str
) -> None:
    words = ["assets", "import", str(cabinet), "--class", "my_door", "--name", "1", "--out", str(tmp_path / "lib")]
    assert cli.run([*words, "--keypoint", option]) == 2
    assert re.search(message, capfd.readouterr().err)
    assert not (tmp_path / "lib").exists()


def test_a_urdf_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"gone\.urdf: cannot be read"):
        import_object(find_source(str(tmp_path / "gone.urdf")), tmp_path / "lib", "my_door", "1")
    with pytest.raises(InputError, match="no such folder"):
        find_source("~nobody-of-this-name/gone.urdf")

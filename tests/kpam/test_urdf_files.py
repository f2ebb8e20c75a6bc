"""Users' URDFs, SRDFs and meshes are read correctly, or refused with link or joint, attribute and remedy."""

from __future__ import annotations

import copy
import pickle
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import gensim2_kpam as kpam
from gensim2.objects.library.folder import ObjectFolder
from gensim2.objects.library.meshes import read_obj
from gensim2.objects.library.urdf import parse_urdf
from gensim2.objects.types import AssetError

LIMIT = '<limit lower="-2.5" upper="2.5" effort="20" velocity="2"/>'
AXES = ("0 0 1", "0 1 0", "0 1 0", "0 0 1")


def arm(joint: str = LIMIT, link: str = "", more: str = "", head: str = '<?xml version="1.0"?>') -> str:
    """An arm of four joints, the second with the elements ``joint``, its child with ``link``."""
    joints = "".join(
        f'<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/><origin xyz="0 0 0.25"/>'
        f'<axis xyz="{axis}"/>{joint if i == 1 else LIMIT}</joint>'
        for i, axis in enumerate(AXES)
    )
    links = "".join(f'<link name="l{i}">{link if i == 2 else ""}</link>' for i in range(5))
    return f'{head}<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="arm">{links}{joints}{more}</robot>'


def read(folder: Path, text: str | bytes, srdf: str | None = None) -> kpam.Robot:
    """Return the robot of a text with the hand ``l4``."""
    file = folder / "arm.urdf"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    if srdf is None:
        return kpam.Robot.from_urdf(file, hand_link="l4")
    (folder / "arm.srdf").write_text(f'<robot name="arm">{srdf}</robot>')
    return kpam.Robot.from_urdf(file, hand_link="l4", srdf=folder / "arm.srdf")


def solid(geometry: str) -> str:
    """Return a collision element."""
    return f"<collision><geometry>{geometry}</geometry></collision>"


FINGER = '<collision><geometry><box size="0.02 0.02 0.05"/></geometry></collision>'


def fingers(second: str) -> str:
    """Return two fingers on the hand that touch when closed; ``second`` are elements of the follower's joint."""
    return (
        f'<link name="fa">{FINGER}</link><link name="fb">{FINGER}</link>'
        '<joint name="ga" type="prismatic"><origin xyz="0 0.01 0.05"/><parent link="l4"/><child link="fa"/>'
        '<axis xyz="0 1 0"/><limit lower="0" upper="0.04" effort="5" velocity="0.1"/></joint>'
        '<joint name="gb" type="prismatic"><origin xyz="0 -0.01 0.05"/><parent link="l4"/><child link="fb"/>'
        f'<axis xyz="0 -1 0"/><mimic joint="ga"/>{second}</joint>'
    )


@pytest.mark.parametrize(
    ("text", "field", "message"),
    [
        (arm(""), "joint j1: limit", "is missing"),
        (arm('<limit effort="10" velocity="1"/>'), "joint j1: limit", "lower is missing"),
        (arm('<limit lower="-1" effort="10" velocity="1"/>'), "joint j1: limit", "upper is missing"),
        (arm('<limit lower="-1" upper="1" effort="1"/>'), "joint j1: limit", 'write velocity="..."'),
        (arm('<limit lower="-1" upper="1" velocity="-1"/>'), "joint j1: limit.velocity", "must not be negative"),
        (arm('<limit lower="-1" upper="1" velocity="1" effort="-1"/>'), "joint j1: limit.effort", "not be negative"),
        (arm('<limit lower="-${pi}" upper="${pi}" velocity="1"/>'), "joint j1: limit.lower", "run `xacro"),
        (arm(more="<xacro:gripper/>"), "robot", "<xacro:gripper> is not expanded; run `xacro"),
        (arm(link=solid('<mesh filename="x.stl" scale="0.001"/>')), "link l2: collision: mesh.scale", "three finite"),
        (arm(link=solid('<mesh filename="$(find arm)/x.stl"/>')), "link l2: collision: mesh.filename", "xacro"),
        (arm(link=solid('<cylinder radius="0" length="1"/>')), "link l2: collision: cylinder.radius", "positive"),
        (
            arm(link="<inertial><mass value='1'/></inertial>"),
            "link l2: inertial",
            "has no <inertia>; add it",
        ),
        (arm(link="<visual><material name='x'/></visual>"), "link l2: visual", "has no <geometry>; add it"),
        (arm(link=FINGER.replace("collision", "colision")), "link l2", "write <collision>"),
    ],
)
def test_a_refusal_names_link_or_joint_attribute_and_remedy(
    tmp_path: Path, text: str, field: str, message: str
) -> None:
    with pytest.raises(kpam.UrdfError, match=re.escape(message)) as refused:
        read(tmp_path, text)
    assert refused.value.field == field
    assert len(str(refused.value).splitlines()) == 1


def test_an_srdf_is_read_in_full(tmp_path: Path) -> None:
    box = '<collision><geometry><box size="0.05 0.05 0.6"/></geometry></collision>'
    small = '<collision><geometry><box size="0.02 0.02 0.02"/></geometry></collision>'
    text = arm(link=small).replace('<link name="l1">', f'<link name="l1">{box}').replace('"l3">', f'"l3">{box}', 1)

    def collides(srdf: str) -> bool:
        return bool(kpam.Scene(read(tmp_path, text, srdf)).in_collision([0.0] * 4))

    assert collides("")
    assert not collides('<disable_collisions link1="l1" link2="l3"/>')
    assert not collides('<disable_default_collisions link="l1"/>')
    assert collides('<disable_default_collisions link="l1"/><enable_collisions link1="l3" link2="l1"/>')
    for srdf, named in (
        ('<disable_collisionss link1="l1" link2="l3"/>', "disable_collisionss"),
        ('<disable_collisions link1="l1" link2="link_3"/>', "link_3"),
        ('<disable_collisions link1="l1"/>', "link2"),
    ):
        with pytest.raises(kpam.UrdfError, match=named):
            collides(srdf)


def test_a_follower_without_limits_restricts_nothing_and_fingers_may_touch(tmp_path: Path) -> None:
    follows = read(tmp_path, arm('<limit lower="-1" upper="1" effort="1" velocity="1"/>').replace(
        f'<axis xyz="0 1 0"/>{LIMIT}', '<axis xyz="0 1 0"/><mimic joint="j1"/>'
    ))  # fmt: skip
    assert kpam.Scene(follows).plan_to([0.0] * 4, [0.5] * 4).status == "solved"
    for second in ("", '<limit lower="0" upper="0.04" effort="5" velocity="0.1"/>'):
        robot = read(tmp_path, arm(more=fingers(second)))
        pads = ([0, 0, 0.1], [0, 0, 0], [0, 0.03, 0.1])
        assert kpam.ParallelGripper.of_robot(robot, *pads).stroke == pytest.approx((0.0, 0.08))
        motion = kpam.Scene(robot).plan_to([0.0] * 6, [0.5] * 4 + [0.0, 0.0])
        assert motion.status == "solved", motion.reason


@pytest.mark.parametrize("limit", ['acceleration="1e-120"', 'jerk="1e12"'])
def test_accelerations_and_jerks_that_no_arm_has_are_refused_by_joint(tmp_path: Path, limit: str) -> None:
    robot = read(tmp_path, arm(LIMIT.replace("/>", f" {limit}/>")))
    with pytest.raises(kpam.ProblemError, match=r"joint j1 has the (acceleration|jerk) limit"):
        kpam.Scene(robot).plan_to(np.zeros(4), np.full(4, 0.5))


def test_acceleration_and_jerk_of_a_urdf_hold_and_what_is_assumed_is_said(tmp_path: Path) -> None:
    slow = LIMIT.replace("/>", ' acceleration="0.5" deceleration="0.5" jerk="4"/>')
    for text, assumed, most in ((arm().replace(LIMIT, slow), [], 0.5), (arm(slow), ["acceleration", "jerk"], 10.0)):
        robot = read(tmp_path, text)
        motion = kpam.Scene(robot).plan_to([0.0] * 4, [1.0] * 4)
        assert motion.assumed_limits == assumed
        assert motion.trajectory is not None
        times = np.linspace(0.0, motion.trajectory.duration, 2000)
        _, velocity, acceleration = motion.trajectory.sample(times)
        assert np.abs(acceleration[:, 1]).max() <= 0.5 + 1e-6
        assert np.abs(acceleration).max() <= most + 1e-6
        assert np.abs(np.diff(acceleration[:, 1]) / np.diff(times)).max() <= 4.0 + 1e-3
        assert np.abs(velocity).max() <= 2.0 + 1e-6
    assert robot.acceleration.tolist() == [np.inf, 0.5, np.inf, np.inf]
    assert robot.jerk[1] == 4.0
    named = kpam.Scene(robot).plan_to([0.0] * 4, [1.0] * 4, limits="plain")
    assert named.assumed_limits == []


@pytest.mark.parametrize("kind", ["revolute", "continuous"])
def test_a_joint_without_a_velocity_limit_is_not_planned(tmp_path: Path, kind: str) -> None:
    limit = '<limit lower="-2.5" upper="2.5" effort="0" velocity="0"/>' if kind == "revolute" else ""
    text = arm(limit).replace('name="j1" type="revolute"', f'name="j1" type="{kind}"')
    robot = read(tmp_path, text)
    assert robot.velocity.tolist() == [2.0, np.inf, 2.0, 2.0]
    scene = kpam.Scene(robot)
    with pytest.raises(kpam.ProblemError, match=r"velocity_limits: joint j1 has no velocity limit"):
        scene.plan_to([0.0] * 4, [1.0] * 4)
    motion = scene.plan_to([0.0] * 4, [1.0] * 4, velocity_limits=[1.0] * 4)
    assert motion.trajectory is not None
    assert np.abs(motion.trajectory.sample(np.linspace(0.0, motion.trajectory.duration, 500))[1]).max() <= 1.0 + 1e-6


def test_a_goal_that_planning_does_not_reach_is_refused(tmp_path: Path) -> None:
    scene = kpam.Scene(read(tmp_path, arm(more=fingers(""))))
    for goal, joint in (([0.0] * 4 + [0.02, 0.02], "ga"), ([0.5] * 4 + [0.0, 0.02], "gb")):
        with pytest.raises(kpam.ProblemError, match=rf"0\.02 cannot be reached: joint {joint}") as refused:
            scene.plan_to([0.0] * 6, goal)
        assert str(refused.value.field).startswith("goal[0][")
    with pytest.raises(kpam.ProblemError, match="joint gb"):
        scene.plan_to([0.0] * 6, [[0.5] * 4 + [0.0, 0.0], [0.5] * 4 + [0.0, 0.01]])


def test_motions_are_copied_and_pickled(tmp_path: Path) -> None:
    scene = kpam.Scene(read(tmp_path, arm()))
    far = kpam.Body("wall", "rigid", [kpam.Shape.box([1, 1, 1])], np.eye(4))
    blocked = kpam.Scene(read(tmp_path, arm(link=FINGER)), [far]).plan_to([0.0] * 4, [1.0] * 4)
    for motion in (scene.plan_to([0.0] * 4, [1.0] * 4), blocked):
        for again in (pickle.loads(pickle.dumps(motion)), copy.deepcopy(motion), copy.copy(motion)):
            for name in ("status", "reason", "goal", "nearer", "checks", "assumed_limits", "cpu_ms"):
                assert getattr(again, name) == getattr(motion, name), name
            assert (again.corners is None) == (motion.corners is None)
            if motion.trajectory is not None:
                assert again.trajectory.sample(0.3)[0].tolist() == motion.trajectory.sample(0.3)[0].tolist()


def test_a_body_has_a_name_of_its_own(tmp_path: Path) -> None:
    body = kpam.Body("l2", "rigid", [kpam.Shape.sphere(0.1)], np.eye(4))
    with pytest.raises(kpam.ProblemError, match=r'bodies\[0\]\.name: "l2" is a link of the robot'):
        kpam.Scene(read(tmp_path, arm()), [body])


def test_a_cloud_without_points_is_no_obstacle(tmp_path: Path) -> None:
    robot = read(tmp_path, arm(link=FINGER))
    empty = kpam.Body("cloud", "rigid", [kpam.Shape.point_cloud(np.zeros((0, 3)), 0.005)], np.eye(4))
    scene = kpam.Scene(robot, [empty])
    assert not scene.in_collision([0.0] * 4)
    assert scene.plan_to([0.0] * 4, [1.0] * 4).status == "solved"
    assert scene.own_points([0.0] * 4, np.zeros((0, 3))).shape == (0,)
    assert [part.shape for part in empty.surface()] == [(0, 3, 3), (0, 4)]
    with pytest.raises(kpam.ProblemError, match="radius"):
        kpam.Shape.point_cloud(np.zeros((0, 3)), -1.0)


def test_a_flat_hull_is_drawn() -> None:
    square = [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.1, 0.1, 0]]
    triangles, _ = kpam.Body("f", "rigid", [kpam.Shape.convex_hull(square)], np.eye(4)).surface()
    area = 0.5 * np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    assert area.sum() == pytest.approx(0.01)


CUBE = "".join(f"v {x} {y} {z}\n" for x in (0, 0.05) for y in (0, 0.05) for z in (0, 0.05))
FACES = "f 1 2 4 3\nf 5 6 8 7\nf 1 2 6 5\nf 3 4 8 7\nf 1 3 7 5\nf 2 4 8 6\n"
WRITTEN: dict[str, Callable[[str], str]] = {
    "as it is": lambda text: text,
    "DOS": lambda text: text.replace("\n", "\r\n"),
    "old Mac": lambda text: text.replace("\n", "\r"),
    "tabs": lambda text: text.replace(" ", "\t").replace("v\t", "\t v \t"),
    "unused vertex": lambda text: text.replace(FACES, f"v 5 5 5\n{FACES}"),
    "goes on": lambda text: text.replace("f 1 2 4 3", "f 1 2 \\\n4 3"),
    "a face before its vertices": lambda text: FACES + CUBE,
    "a mark before the text": lambda text: "\ufeff" + text,
}


@pytest.mark.parametrize("way", WRITTEN)
def test_robots_and_objects_read_the_same_of_an_obj_file(tmp_path: Path, way: str) -> None:
    (tmp_path / "a.obj").write_bytes(WRITTEN[way](CUBE + FACES).encode())
    robot = read(tmp_path, arm(link=solid('<mesh filename="a.obj"/>')))
    corners = robot.surface("l2")[0].reshape(-1, 3)
    meshes = read_obj(ObjectFolder(tmp_path), "a.obj").meshes
    for points in (corners, np.concatenate([mesh.vertices for mesh in meshes])):
        assert np.ptp(points, axis=0) == pytest.approx([0.05] * 3)


@pytest.mark.parametrize("text", ["v 0 0 0\n", "v 0 0\nf 1 1 1\n", "v 0 0 0\nf 1 1 9\n", "v 0 0 nan\nf 1 1 1\n", ""])
def test_robots_and_objects_refuse_the_same_obj_files(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.obj").write_text(text)
    with pytest.raises(ValueError, match=r"\w"):
        read_obj(ObjectFolder(tmp_path), "a.obj")
    with pytest.raises(kpam.UrdfError, match=r"link l2: collision: mesh .*a\.obj"):
        read(tmp_path, arm(link=solid('<mesh filename="a.obj"/>')))


def test_keywords_of_an_stl_file_may_be_capital(tmp_path: Path) -> None:
    corners = ["0 0 0", "0.05 0 0", "0 0.05 0", "0 0 0.05"]
    facets = "".join(
        "FACET NORMAL 0 0 0\nOUTER LOOP\n" + "".join(f"VERTEX {corners[k]}\n" for k in face) + "ENDLOOP\nENDFACET\n"
        for face in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))
    )
    text = f"SOLID PART\n{facets}ENDSOLID\n"
    for ends in ("\n", "\r\n", "\r"):
        for content in (text, text.lower()):
            (tmp_path / "a.stl").write_bytes(content.replace("\n", ends).encode())
            robot = read(tmp_path, arm(link=solid('<mesh filename="a.stl"/>')))
            assert np.ptp(robot.surface("l2")[0].reshape(-1, 3), axis=0) == pytest.approx([0.05] * 3)


LATIN = arm(head='<?xml version="1.0" encoding="ISO-8859-1"?><!-- Gelenkträger -->')


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (arm().encode(), None),
        (LATIN.encode("latin-1"), None),
        (LATIN.replace("ISO-8859-1", "UTF-16").encode("utf-16"), None),
        (b"\xef\xbb\xbf" + arm().encode(), None),
        (arm().replace('rpy="0 0 0"', "").replace("<origin ", '<origin quat_xyzw="0 0 0 1" ').encode(), None),
        (arm(head="<!-- Gelenkträger -->").encode("latin-1"), "not UTF-8"),
        (LATIN.replace("ISO-8859-1", "klingon").encode(), "klingon"),
        (b"", "no element found"),
        (arm()[:-9].encode(), "not XML"),
        (arm(more='<link name="l1"/>').encode(), "two links have this name"),
        (arm().replace("l4", "l3").encode(), "have this name|is already the child of"),
        (
            arm(more="<joint name='x' type='fixed'><parent link='l0'/><child link='no'/></joint>").encode(),
            "no link 'no'",
        ),
        (arm().replace("0 0 0.25", "0 0").encode(), "three finite numbers"),
        (arm(link="<visual/>").encode(), "has no <geometry>"),
    ],
)
def test_robots_and_objects_read_the_same_of_a_urdf(tmp_path: Path, content: bytes, message: str | None) -> None:
    file = tmp_path / "arm.urdf"
    if message is None:
        robot, urdf = read(tmp_path, content), parse_urdf(content, file)
        assert robot.link_names == list(urdf.links)
        assert robot.joint_names == [joint.name for joint in urdf.joints]
        hand = np.linalg.multi_dot([joint.T for joint in urdf.joints])
        np.testing.assert_allclose(robot.forward_kinematics([0.0] * 4), hand, atol=1e-12)
        return
    with pytest.raises(kpam.UrdfError, match=message):
        read(tmp_path, content)
    with pytest.raises(AssetError, match=message):
        parse_urdf(content, file)

"""Kinematics compared with Pinocchio and finite differences."""

from __future__ import annotations

import pickle
import re
from pathlib import Path

import numpy as np
import pytest

import gensim2_kpam as kpam

pin = pytest.importorskip("pinocchio")


def pinocchio_model(urdf: Path) -> pin.Model:
    # Pinocchio would remove a mimic joint from the joint vector.
    return pin.buildModelFromXML(re.sub(r"<mimic[^>]*/>", "", urdf.read_text()))


def test_agrees_with_pinocchio(panda: kpam.Robot, robots: Path) -> None:
    model = pinocchio_model(robots / "panda" / "panda_v2.urdf")
    data = model.createData()
    assert list(model.names)[1:] == panda.joint_names
    draw = np.random.default_rng(0)
    # The second finger follows the first one, so its motion belongs to the column of the first one.
    q = panda.apply_mimic(draw.uniform(panda.lower, panda.upper, (1000, 9)))
    for link in ("panda_hand", "panda_link5", "panda_rightfinger"):
        frame = model.getFrameId(link)
        poses, jacobians = panda.forward_kinematics(q, link), panda.jacobian(q, link)
        for index, row in enumerate(q):
            expected = pin.computeFrameJacobian(model, data, row, frame, pin.LOCAL_WORLD_ALIGNED)
            expected[:, 7], expected[:, 8] = expected[:, 7] + expected[:, 8], 0.0
            pin.framesForwardKinematics(model, data, row)
            np.testing.assert_allclose(poses[index], data.oMf[frame].homogeneous, atol=1e-9)
            np.testing.assert_allclose(jacobians[index], expected, atol=1e-9)


def test_jacobian_is_the_derivative(panda: kpam.Robot) -> None:
    q = np.random.default_rng(1).uniform(panda.lower, panda.upper, (20, 9))
    step = 1e-6
    for row in q:
        jacobian = panda.jacobian(row)
        for joint in range(9):
            change = np.zeros(9)
            change[joint] = step
            after, before = (panda.forward_kinematics(row + sign * change) for sign in (1, -1))
            linear = (after[:3, 3] - before[:3, 3]) / (2 * step)
            spin = (after[:3, :3] - before[:3, :3]) @ panda.forward_kinematics(row)[:3, :3].T / (2 * step)
            angular = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
            np.testing.assert_allclose(jacobian[:3, joint], linear, atol=1e-7)
            np.testing.assert_allclose(jacobian[3:, joint], angular, atol=1e-7)


def test_shapes_and_bad_input(panda: kpam.Robot) -> None:
    q = np.zeros(9)
    assert panda.forward_kinematics(q).shape == (4, 4)
    assert panda.forward_kinematics(np.zeros((3, 9))).shape == (3, 4, 4)
    assert panda.jacobian(np.zeros((0, 9))).shape == (0, 6, 9)
    with pytest.raises(kpam.ProblemError, match="q: must have shape"):
        panda.forward_kinematics(np.zeros(8))
    with pytest.raises(kpam.ProblemError, match="not finite"):
        panda.jacobian(np.full(9, np.nan))
    with pytest.raises(kpam.ProblemError, match="nowhere"):
        panda.jacobian(q, "nowhere")


def test_robot_pickles(panda: kpam.Robot) -> None:
    again = pickle.loads(pickle.dumps(panda))
    q = np.linspace(-0.5, 0.5, 9)
    np.testing.assert_array_equal(again.forward_kinematics(q), panda.forward_kinematics(q))


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "XML"),
        ("<robot", "XML"),
        ("<a-b xmlns='urn:x' c:d='1'/>", "XML"),
        ("<robot name='a'/>", "links"),
        ("<robot name='a'>" + "<b>" * 100_000 + "</b>" * 100_000 + "</robot>", "deep"),
        ("<robot name='a'>" + "".join(f"<link name='b{i}'/>" for i in range(10_001)) + "</robot>", "10001 links"),
        (
            "<robot name='a'><link name='b'/><link name='h'/><joint name='j' type='revolute'><parent link='b'/>"
            "<child link='h'/><axis xyz='0 0 1'/>"
            "<limit lower='nan' upper='1' effort='1' velocity='1'/></joint></robot>",
            "joint j: limit",
        ),
        (
            "<robot name='a'><link name='b'/><link name='h'/><joint name='j' type='revolute'><origin xyz='1e300 0 0'/>"
            "<parent link='b'/><child link='h'/><axis xyz='0 0 1'/>"
            "<limit lower='0' upper='1' effort='1' velocity='1'/></joint></robot>",
            "joint j: origin",
        ),
        ("<robot name='a'><link name='b'/></robot>", "hand_link"),
        (
            "<robot name='a'><link name='b'/><link name='h'/><joint name='j' type='revolute'><parent link='b'/>"
            "<child link='h'/><axis xyz='0 0 0'/><limit lower='0' upper='1' effort='1' velocity='1'/></joint></robot>",
            "joint j: axis",
        ),
        (
            "<robot name='a'><link name='b'/><link name='h'/><joint name='j' type='revolute'><parent link='b'/>"
            "<child link='h'/><axis xyz='0 0 1'/><limit lower='2' upper='1' effort='1' velocity='1'/></joint></robot>",
            "joint j: limit",
        ),
        (
            "<robot name='a'><link name='b'/><link name='h'><collision><geometry><mesh filename='gone.stl'/></geometry>"
            "</collision></link><joint name='j' type='fixed'><parent link='b'/><child link='h'/></joint></robot>",
            "gone.stl",
        ),
        (
            "<robot name='a'><link name='b'/><link name='h'/><joint name='j' type='fixed'><parent link='b'/>"
            "<child link='h'/></joint><joint name='k' type='fixed'><parent link='h'/><child link='b'/></joint></robot>",
            "loop",
        ),
    ],
)
def test_a_bad_urdf_is_named(tmp_path: Path, text: str, what: str) -> None:
    file = tmp_path / "bad.urdf"
    file.write_text(text)
    with pytest.raises(kpam.UrdfError, match=what) as caught:
        kpam.Robot.from_urdf(file, hand_link="h" if "'h'" in text else "hand")
    assert "bad.urdf" in str(caught.value)


def test_what_other_tools_add_under_their_namespace_is_left_out(tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    file.write_text(
        "<?xml version='1.0'?>"
        "<robot xmlns='urn:robots' xmlns:x='http://ros.org/xacro' x:by='&lt;us&gt;' name='a &amp; b'>"
        "<x:link name='no'/><link name='b'/><link name='&quot;h&#9;'><x:note>text</x:note></link>"
        "<joint name='j' type='revolute'><parent link='b'/><child link='&quot;h&#9;'/><axis xyz='0 0 1'/>"
        "<limit lower='-1' upper='1' effort='1' velocity='1'/></joint></robot>"
    )
    robot = kpam.Robot.from_urdf(file, hand_link='"h\t')
    assert robot.joint_names == ["j"]
    assert robot.link_names == ["b", '"h\t']


def test_a_missing_urdf_is_named(tmp_path: Path) -> None:
    with pytest.raises(kpam.UrdfError, match=r"none\.urdf"):
        kpam.Robot.from_urdf(tmp_path / "none.urdf", hand_link="hand")


def test_pickles_of_another_layout_are_named(panda: kpam.Robot) -> None:
    make, (data,) = panda.__reduce__()  # type: ignore[misc]
    assert data[:4] == b"kpam"
    with pytest.raises(kpam.KpamError, match="layout 250"):
        make(data[:4] + bytes([250]) + data[5:])
    with pytest.raises(kpam.KpamError, match="no version"):
        make(data[5:])
    with pytest.raises(kpam.KpamError, match="damaged"):
        make(data[:20])


def test_compiling_the_world_is_no_part_of_the_actuation(panda: kpam.Robot) -> None:
    from .kpam_scenes import problem

    cpu = kpam.plan(problem(panda)).cpu_ms
    assert cpu["setup"] > 0.0
    assert cpu["total"] == pytest.approx(cpu["setup"] + cpu["actuation"] + cpu["trajectory"])

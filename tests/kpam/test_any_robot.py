"""Robots as they come: without an SRDF, with meshes in COLLADA, glTF or ROS packages, and with mimic joints."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
import trimesh

import gensim2_kpam as kpam

UR5E = Path(__file__).parents[2] / "examples" / "robots" / "ur5e.urdf"
LIMIT = '<limit lower="-2" upper="2" effort="1" velocity="1"/>'


def link(name: str, geometry: str = "", at: str = "0 0 0") -> str:
    """Return a link with a collision shape at ``at`` (m)."""
    shape = f'<collision><origin xyz="{at}"/><geometry>{geometry}</geometry></collision>' if geometry else ""
    return f'<link name="{name}">{shape}</link>'


def joint(name: str, parent: str, child: str, at: str, axis: str, rest: str = LIMIT, kind: str = "revolute") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/>'
        f'<axis xyz="{axis}"/>{rest}</joint>'
    )


def read(folder: Path, body: str, hand: str, **arguments: object) -> kpam.Robot:
    """Return the robot of a URDF with the elements ``body``, written to ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "arm.urdf").write_text(f'<robot name="arm">{body}</robot>')
    return kpam.Robot.from_urdf(folder / "arm.urdf", hand_link=hand, **arguments)  # type: ignore[arg-type]


BAR = '<box size="0.4 0.05 0.05"/>'
# Two bars that turn about parallel axes. They cross if both point at each other, which is the middle of their ranges.
# The cap lies inside the base at every joint value, and a link without a shape of its own lies between them.
TWO_BARS = (
    link("base", '<box size="0.1 0.1 0.1"/>', "0 0 -0.2")
    + link("left", BAR, "0.2 0 0")
    + link("right", BAR, "-0.2 0 0")
    + link("turn", '<box size="0.02 0.02 0.02"/>', "0 0 0.1")
    + link("cap", '<box size="0.02 0.02 0.02"/>')
    + joint("a", "base", "left", "0 0 0", "0 0 1")
    + joint("b", "base", "right", "0.6 0 0", "0 0 1")
    + joint("c", "base", "turn", "0 0 -0.2", "0 0 1")
    + joint("d", "turn", "cap", "0 0 0", "0 0 1")
)


def test_links_that_cross_in_few_configurations_are_checked_without_an_srdf(tmp_path: Path) -> None:
    robot = read(tmp_path, TWO_BARS, "left")
    assert robot.unchecked_pairs == [("base", "cap")]
    assert kpam.Scene(robot).in_collision([0.0, 0.0, 0.0, 0.0])
    assert not kpam.Scene(robot).in_collision([1.0, 0.0, 0.0, 0.0])
    motion = kpam.Scene(robot).plan_to([1.0, 0, 0, 0], [-1.0, 0, 0, 0])
    assert motion.status == "not_found"
    assert any("base and cap" in warning for warning in kpam.Scene(robot).plan_to([1.0] * 4, [1.1, 1, 1, 1]).warnings)


def test_the_matrix_of_self_collisions_states_each_pair_and_is_written_as_srdf(tmp_path: Path) -> None:
    robot = read(tmp_path, TWO_BARS, "left")
    file = tmp_path / "arm.srdf"
    pairs = robot.self_collisions(srdf=file)
    assert len(pairs) == 10  # of five links
    found = {frozenset(pair["links"]): pair for pair in pairs}
    assert found[frozenset(("base", "cap"))]["relation"] == "always"
    assert found[frozenset(("base", "left"))]["relation"] == "adjacent"
    crossing = found[frozenset(("left", "right"))]
    assert (crossing["relation"], crossing["checked"]) == ("sometimes", True)
    assert 0.0 < crossing["fraction"] < 0.5
    never = found[frozenset(("right", "cap"))]
    assert (never["relation"], never["fraction"], never["checked"]) == ("never", 0.0, True)
    # An independent count of the crossing bars.
    q = np.random.default_rng(3).uniform(-2, 2, (2000, 4))
    rows = kpam.Scene(robot).check(q, 0.0)
    share = np.mean([any({*hit["bodies"]} == {"left", "right"} for hit in row) for row in rows])
    assert crossing["fraction"] == pytest.approx(share, abs=0.04)

    again = kpam.Robot.from_urdf(tmp_path / "arm.urdf", hand_link="left", srdf=file)
    assert again.unchecked_pairs == []
    assert again.self_collisions() == pairs
    assert robot.self_collisions(seed=1) != pairs
    relaxed = robot.self_collisions(always=crossing["fraction"])
    assert not {frozenset(p["links"]): p for p in relaxed}[frozenset(("left", "right"))]["checked"]
    for wrong in ({"samples": 0}, {"always": 0.0}, {"always": 1.5}):
        with pytest.raises(kpam.ProblemError, match=next(iter(wrong))):
            robot.self_collisions(**wrong)
    with pytest.raises(kpam.ProblemError, match=r"srdf: .*cannot be written"):
        robot.self_collisions(srdf=tmp_path / "missing" / "arm.srdf")


def test_links_that_overlap_at_the_start_are_named_with_the_remedy(tmp_path: Path) -> None:
    point = {"type": "point2point_constraint", "keypoint_name": "tip", "target_keypoint_name": "goal"}
    problem = kpam.Scene(read(tmp_path, TWO_BARS, "left")).problem(
        kpam.SolverConfig({"constraint_list": [{**point, "tolerance": 0.01}]}),
        [0.0] * 4,
        tool_keypoints={"tip": [0.4, 0, 0]},
        object_keypoints={"goal": [0.0, 0.4, 0.0]},
    )
    plan = kpam.plan(problem)
    assert plan.status == "start_in_collision"
    assert "left" in plan.reason
    assert "right" in plan.reason
    assert "if these links may touch, disable the pair in an SRDF, which robot.self_collisions writes" in plan.reason


@pytest.mark.parametrize(
    ("start", "goal"),
    [
        ([-0.12, -2.27, 2.45, 2.81, -2.68, 0.15], [-1.97, -1.75, 1.51, 1.33, -1.94, -1.05]),
        ([-2.22, -0.29, -0.08, 0.62, 1.01, -1.84], [1.9, -1.72, -0.01, -2.33, -1.53, -0.28]),
        ([-2.29, -1.51, 2.52, -1.5, 1.64, 1.26], [-0.83, -0.74, 2.63, -1.8, -1.49, -0.69]),
    ],
)
def test_links_that_are_always_close_do_not_block_keypoint_plans(start: list[float], goal: list[float]) -> None:
    """The rule of motions to a goal: these links are 0.5 to 0.8 mm apart, less than the margin, in every state."""
    robot = kpam.Robot.from_urdf(UR5E, hand_link="flange")
    scene = kpam.Scene(robot)
    pose = robot.forward_kinematics(goal)

    def along(keypoint: str, axis: int) -> dict[str, object]:
        return {
            "type": "frame_axis_parallel",
            "axis_from_keypoint_name": "tail",
            "axis_to_keypoint_name": keypoint,
            "target_axis": pose[:3, axis].tolist(),
            "target_axis_frame": "world",
            "target_inner_product": 1.0,
            "tolerance": 0.01,
        }

    point = {"type": "point2point_constraint", "keypoint_name": "tip", "target_keypoint_name": "goal"}
    config = {
        "constraint_list": [{**point, "tolerance": 0.001}, along("tip", 2), along("side", 0)],
        "pre_actuation_motions": [["translate_z", -0.05]],
    }
    problem = scene.problem(
        kpam.SolverConfig(config),
        start,
        tool_keypoints={"tip": [0, 0, 0.1], "tail": [0, 0, 0], "side": [0.1, 0, 0]},
        object_keypoints={"goal": pose[:3, :3] @ [0, 0, 0.1] + pose[:3, 3]},
    )
    plan = kpam.plan(problem)
    assert plan.status == "solved", plan.reason
    assert plan.trajectory is not None
    for row in scene.check(plan.trajectory.sample_every(0.01), 0.005 - 2e-4):
        for pair in row:
            assert pair["bodies"] == ("base_link", "upper_arm_link")
            assert pair["distance"] > 0.0


def mesh_link(filename: str, scale: str = "1 1 1") -> str:
    return link("l0") + link("l1", f'<mesh filename="{filename}" scale="{scale}"/>') + joint(
        "j", "l0", "l1", "0 0 0", "0 0 1"
    )  # fmt: skip


def corners(robot: kpam.Robot) -> np.ndarray:
    """Return the bounds (2, 3) of the link ``l1``, m."""
    points = robot.surface("l1")[0].reshape(-1, 3)
    return np.array([points.min(axis=0), points.max(axis=0)])


@pytest.mark.parametrize("suffix", ["dae", "glb", "gltf", "DAE"])
def test_collada_and_gltf_meshes_are_read_in_place(tmp_path: Path, suffix: str) -> None:
    """Two parts of a scene, each with its own transform, as trimesh writes them."""
    scene = trimesh.Scene()
    turn = trimesh.transformations.rotation_matrix(np.pi / 2, [0, 0, 1], [0, 0, 0])
    turn[:3, 3] = [0.3, 0.1, 0.0]
    scene.add_geometry(trimesh.creation.box((0.1, 0.2, 0.3)), transform=turn)
    scene.add_geometry(trimesh.creation.icosphere(radius=0.05), transform=np.diag([2.0, 1.0, 1.0, 1.0]))
    if suffix == "gltf":
        for name, data in trimesh.exchange.gltf.export_gltf(scene).items():
            (tmp_path / ("part.gltf" if name == "model.gltf" else name)).write_bytes(data)
    elif suffix == "glb":
        scene.export(tmp_path / "part.glb")
    else:
        pytest.importorskip("collada")
        whole = scene.to_mesh()
        (tmp_path / f"part.{suffix}").write_bytes(trimesh.exchange.dae.export_collada(whole))
    robot = read(tmp_path, mesh_link(f"part.{suffix}", "1 1 2"), "l1")
    wanted = scene.bounds * [1, 1, 2]
    np.testing.assert_allclose(corners(robot), wanted, atol=1e-6)


def test_a_mesh_that_cannot_be_read_is_named_with_the_remedy(tmp_path: Path) -> None:
    for name, content, message in (
        ("part.dae", b"<COLLADA/>", r"part\.dae: has no <visual_scene>"),
        ("part.dae", b"text", r"part\.dae: not XML"),
        ("part.glb", b"glTF\1\0\0\0" + bytes(40), r"part\.glb: is glTF version 1; export it as version 2"),
        ("part.gltf", b"{}", r"part\.gltf: has no scene"),
        ("part.fbx", b"", r"read from \.stl, \.ply, \.obj, \.dae, \.glb and \.gltf, not \.fbx; convert it"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(kpam.UrdfError, match=message) as refused:
            read(tmp_path, mesh_link(name), "l1")
        assert refused.value.field == "link l1: collision"


def package(folder: Path, size: float, name: str | None = None) -> None:
    """Write a package whose mesh is a cube with sides of ``size`` (m)."""
    (folder / "meshes").mkdir(parents=True)
    trimesh.creation.box((size, size, size)).export(folder / "meshes" / "part.stl")
    if name is not None:
        (folder / "package.xml").write_text(f"<package><name>{name}</name></package>")


def test_the_package_that_is_named_wins_over_others_with_the_same_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def side(**arguments: object) -> float:
        robot = read(urdf, mesh_link("package://hand_description/meshes/part.stl"), "l1", **arguments)
        return float(np.ptp(corners(robot)[:, 0]))

    urdf = tmp_path / "source" / "arm_description" / "urdf"
    package(tmp_path / "source" / "arm_description", 0.1, "arm_description")
    # Another package with the same relative path is not used.
    with pytest.raises(kpam.UrdfError, match=r"hand_description/meshes/part\.stl was not found.*package_dirs="):
        side()
    # A folder with another name is the package if its package.xml says so.
    package(tmp_path / "ros" / "stacks" / "hand-v2", 0.2, "hand_description")
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"{tmp_path / 'none'}:{tmp_path / 'ros'}")
    assert side() == pytest.approx(0.2)
    package(tmp_path / "ament" / "share" / "hand_description", 0.3)
    monkeypatch.delenv("ROS_PACKAGE_PATH")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ament"))
    assert side() == pytest.approx(0.3)
    package(tmp_path / "own" / "hand_description", 0.4)
    for given in (tmp_path / "own", str(tmp_path / "own" / "hand_description")):
        assert side(package_dirs=[given]) == pytest.approx(0.4)
    # Without search paths, a package beside that of the URDF.
    monkeypatch.delenv("AMENT_PREFIX_PATH")
    package(tmp_path / "source" / "hand_description", 0.5)
    assert side() == pytest.approx(0.5)


def test_a_package_without_its_folder_is_found_above_the_urdf(tmp_path: Path) -> None:
    """Many archives contain only the content of a package, in a folder of another name."""
    package(tmp_path / "download", 0.1)
    robot = read(tmp_path / "download" / "urdf", mesh_link("package://arm_description/meshes/part.stl"), "l1")
    assert np.ptp(corners(robot)[:, 0]) == pytest.approx(0.1)


FINGER = '<box size="0.01 0.01 0.04"/>'
SLIDE = '<limit lower="0" upper="0.05" effort="1" velocity="0.1"/>'
FOLLOWS = '<mimic joint="drive" multiplier="{}"/>'
GRIPPER = (
    link("base")
    + link("arm", '<box size="0.05 0.05 0.1"/>')
    + link("palm", '<box size="0.1 0.1 0.02"/>')
    + link("f1", FINGER)
    + link("f2", FINGER)
    + link("f3", FINGER)
    + joint("j", "base", "arm", "0 0 0", "0 0 1")
    + joint("k", "arm", "palm", "0 0 0.2", "0 1 0")
    + joint("m2", "palm", "f2", "0 -0.01 0.04", "0 -1 0", SLIDE + FOLLOWS.format(1), "prismatic")
    + joint("drive", "palm", "f1", "0 0.01 0.04", "0 1 0", SLIDE, "prismatic")
    + joint("m3", "palm", "f3", "0.03 0 0.04", "1 0 0", SLIDE + FOLLOWS.format(0.5), "prismatic")
)


def test_mimic_joints_follow_their_source_in_every_query(tmp_path: Path) -> None:
    robot = read(tmp_path, GRIPPER, "palm")
    assert robot.joint_names == ["j", "k", "m2", "drive", "m3"]
    given = np.array([0.3, 0.2, 0.0, 0.04, 0.0])
    whole = [0.3, 0.2, 0.04, 0.04, 0.02]
    np.testing.assert_allclose(robot.apply_mimic(given), whole)
    np.testing.assert_allclose(robot.apply_mimic([given, given]), [whole, whole])
    for name in ("f1", "f2", "f3"):
        np.testing.assert_allclose(robot.forward_kinematics(given, name), robot.forward_kinematics(whole, name))
    # The Jacobian is the derivative of the kinematics by the entries that move something.
    numeric = np.zeros((3, 5))
    for k in range(5):
        step = np.eye(5)[k] * 1e-6
        ends = [robot.forward_kinematics(given + sign * step, "f3")[:3, 3] for sign in (1, -1)]
        numeric[:, k] = (ends[0] - ends[1]) / 2e-6
    np.testing.assert_allclose(robot.jacobian(given, "f3")[:3], numeric, atol=1e-8)
    assert robot.jacobian(given, "f3")[:, 4].tolist() == [0.0] * 6
    assert np.linalg.norm(robot.jacobian(given, "f3")[:, 3]) == pytest.approx(0.5)


def test_mimic_fingers_follow_in_checks_motions_and_with_attached_bodies(tmp_path: Path) -> None:
    robot = read(tmp_path, GRIPPER, "palm")
    finger = robot.forward_kinematics([0.0, 0.0, 0.04, 0.04, 0.02], "f2")
    block = kpam.Body("block", "rigid", [kpam.Shape.box([0.004, 0.004, 0.004])], finger)
    scene = kpam.Scene(robot, [block])
    opened, closed = [0.0, 0.0, 0.0, 0.04, 0.0], [0.0] * 5
    assert scene.in_collision(opened)
    assert not scene.in_collision(closed)
    assert scene.distance(opened) < 0 < scene.distance(closed)
    assert {hit["bodies"] for hit in scene.check(opened, 0.0)} == {("f2", "block")}
    assert scene.own_points(opened, finger[None, :3, 3], 1e-3).all()
    assert not scene.own_points(closed, finger[None, :3, 3], 1e-3).any()
    assert scene.plan_to(opened, [0.5, 0.5, 0.04, 0.04, 0.02]).status == "start_blocked"
    # With a body in the hand, both finger joints keep the value of the drive joint during the whole motion.
    away = kpam.Body("block", "rigid", [kpam.Shape.box([0.004, 0.004, 0.004])], robot.forward_kinematics(closed))
    held = kpam.Scene(robot, [away]).attached("block", opened)
    motion = held.plan_to(opened, [0.5, 0.5, 0.04, 0.04, 0.02])
    assert motion.trajectory is not None, motion.reason
    for q, drive in itertools.product(motion.trajectory.positions, [0.04]):
        np.testing.assert_allclose(q[2:], [drive, drive, drive / 2], atol=1e-12)


def test_measured_fingers_that_differ_a_little_do_not_matter() -> None:
    from gensim2.robots import robot

    panda = robot("panda").model
    start = np.array([0.0, -0.3, 0.0, -2.6, 0.0, 2.2, 0.8, 0.0213, 0.0209])
    goal = start.copy()
    goal[0] = 0.4
    motion = kpam.Scene(panda, []).plan_to(start, goal)
    assert motion.trajectory is not None

"""Planning scenes and point clouds, serialized as ROS 2 does, as obstacles of the solver."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gensim2_ros import ErrorCode, Planner, RefusedError
from gensim2_ros.collision_matrix import AllowedCollisions
from gensim2_ros.points import cloud_points, occupied_cells

from .octomaps import BINARY, FULL, LEAVES
from .ros_messages import make, message
from .ros_requests import (
    PANDA_START,
    START,
    at,
    difference,
    header,
    joint_goal,
    panda_planner,
    pose,
    primitive,
    request,
    thing,
    ur5e_planner,
    vector3,
)

ADD, REMOVE, APPEND, MOVE = 0, 1, 2, 3
FAR = at(1.2, -0.4, 0.3, [0.3, -0.2, 0.5])


@pytest.fixture
def planner() -> Planner:
    return ur5e_planner()


@pytest.fixture
def panda() -> Planner:
    return panda_planner()


def points_of(planner: Planner, name: str) -> np.ndarray:
    """Return the corners (N, 3) of the triangles of a body in the planning frame, m."""
    (body,) = (each for each in planner.world.scene(START).bodies if each.name == name)
    return np.asarray(body.surface()[0].reshape(-1, 3) @ body.pose[:3, :3].T + body.pose[:3, 3])


def in_frame(points: np.ndarray, frame: np.ndarray) -> np.ndarray:
    return np.asarray((points - frame[:3, 3]) @ frame[:3, :3])


@pytest.mark.parametrize(
    ("shape", "lowest", "highest"),
    [
        (primitive(1, 0.1, 0.2, 0.3), [-0.05, -0.1, -0.15], [0.05, 0.1, 0.15]),
        (primitive(3, 0.4, 0.1), [-0.1, -0.1, -0.2], [0.1, 0.1, 0.2]),
        (primitive(4, 0.4, 0.1), [-0.1, -0.1, -0.2], [0.1, 0.1, 0.2]),
        (primitive(5, 0.2, corners=[(0, 0), (0.3, 0), (0, 0.1)]), [0, 0, -0.1], [0.3, 0.1, 0.1]),
    ],
    ids=["box", "cylinder", "cone", "prism"],
)
def test_primitives_have_their_size_and_pose(planner: Planner, shape: Any, lowest: Any, highest: Any) -> None:
    planner.apply_scene(difference(thing("it", shape, FAR)))
    points = in_frame(points_of(planner, "it"), FAR)
    # Prisms around round shapes with 32 sides are up to 0.5 % wider.
    np.testing.assert_allclose(points.min(axis=0), lowest, atol=6e-4)
    np.testing.assert_allclose(points.max(axis=0), highest, atol=6e-4)


def test_a_sphere_a_mesh_and_a_plane_have_their_place(planner: Planner) -> None:
    planner.apply_scene(difference(thing("ball", primitive(2, 0.5), FAR)))
    (body,) = planner.world.scene(START).bodies
    np.testing.assert_allclose(body.pose @ [*body.surface()[1][0, :3], 1.0], FAR[:, 3], atol=1e-12)
    assert body.surface()[1][0, 3] == 0.5
    corners = np.array([[-9.0, -9.0, 0.0], [9.0, -9.0, 0.0], [0.0, 9.0, 0.0]])
    vertices = [make("geometry_msgs/msg/Point", **dict(zip("xyz", each, strict=True))) for each in corners.tolist()]
    triangle = make("shape_msgs/msg/MeshTriangle", vertex_indices=[2, 1, 0])
    mesh = make("shape_msgs/msg/Mesh", vertices=vertices, triangles=[triangle])
    planner.apply_scene(difference(thing("sheet", meshes=[mesh], mesh_poses=[pose(FAR)])))
    found = in_frame(points_of(planner, "sheet"), FAR)
    np.testing.assert_allclose(found[np.lexsort(found.round(6).T)], corners[np.lexsort(corners.T)], atol=1e-9)
    # The plane 0.6 x + 0.8 z = 1 of its frame, as a box of 2 mm.
    plane = make("shape_msgs/msg/Plane", coef=[1.2, 0.0, 1.6, -2.0])
    planner.apply_scene(difference(thing("wall", planes=[plane], plane_poses=[pose(FAR)])))
    heights = in_frame(points_of(planner, "wall"), FAR) @ [0.6, 0.0, 0.8] - 1.0
    np.testing.assert_allclose(np.abs(heights), 1e-3, atol=1e-9)
    assert np.linalg.norm(in_frame(points_of(planner, "wall"), FAR), axis=1).min() > 14.0


def test_objects_are_added_moved_appended_and_removed(planner: Planner) -> None:
    planner.apply_scene(difference(thing("a", primitive(1, 0.2, 0.2, 0.2), pose=pose(FAR), primitive_poses=[])))
    np.testing.assert_allclose(points_of(planner, "a").mean(axis=0), FAR[:3, 3], atol=1e-9)
    moved = at(-1.0, 0.5, 0.2, [0.0, 0.0, 1.0])
    planner.apply_scene(difference(thing("a", pose=pose(moved), operation=MOVE)))
    np.testing.assert_allclose(np.abs(in_frame(points_of(planner, "a"), moved)), 0.1, atol=1e-9)
    other = thing("a", primitive(1, 0.2, 0.2, 0.2), at(-1.0, 0.5, 1.2), operation=APPEND)
    planner.apply_scene(difference(other))
    assert np.ptp(points_of(planner, "a")[:, 2]) == pytest.approx(1.2)
    planner.apply_scene(difference(thing("b", primitive(2, 0.1), FAR), thing("a", operation=REMOVE)))
    assert list(planner.world.items) == ["b"]
    planner.apply_scene(message("moveit_msgs/msg/PlanningScene", is_diff=False))
    assert not planner.world.items


def test_poses_refer_to_links_objects_subframes_and_transforms(planner: Planner) -> None:
    parent = thing(
        "shelf",
        primitive(1, 0.2, 0.2, 0.2),
        subframe_names=["board"],
        subframe_poses=[pose(at(0.0, 0.0, 0.3))],
        pose=pose(FAR),
    )
    planner.apply_scene(difference(parent))
    stamped = make(
        "geometry_msgs/msg/TransformStamped",
        header=header("base_link"),
        child_frame_id="/map",
        transform=make("geometry_msgs/msg/Transform", translation=vector3((1.0, 2.0, 3.0))),
    )
    frames = {
        "base_link": np.eye(4),
        "wrist_1_link": planner.arm.robot.forward_kinematics(START, "wrist_1_link"),
        "shelf": FAR,
        "shelf/board": FAR @ at(0.0, 0.0, 0.3),
        "map": at(1.0, 2.0, 3.0),
        "/map": at(1.0, 2.0, 3.0),
    }
    planner.apply_scene(difference(fixed_frame_transforms=[stamped]))
    for name, frame in frames.items():
        planner.apply_scene(difference(thing("it", primitive(2, 0.1), at(0.1, 0.2, 0.3), header=header(name))))
        np.testing.assert_allclose(planner.world.items["it"].pose, frame @ at(0.1, 0.2, 0.3), atol=1e-12, err_msg=name)


def attach(link: str, inner: Any, **fields: Any) -> Any:
    held = make("moveit_msgs/msg/AttachedCollisionObject", link_name=link, object=inner, **fields)
    state = make("moveit_msgs/msg/RobotState", attached_collision_objects=[held], is_diff=True)
    return difference(robot_state=state)


def test_an_attached_object_moves_with_the_hand_and_is_released(panda: Planner) -> None:
    hand = panda.arm.robot.forward_kinematics(PANDA_START)
    inside = hand @ at(0.0, 0.0, 0.21)
    panda.apply_scene(difference(thing("rod", primitive(3, 0.2, 0.01), inside)))
    assert panda.world.scene(PANDA_START).bodies[0].role == "rigid"
    panda.apply_scene(attach("panda_leftfinger", thing("rod"), touch_links=["panda_leftfinger"]))
    (body,) = panda.world.scene(PANDA_START).bodies
    assert body.role == "attached"
    np.testing.assert_allclose(hand @ body.pose, inside, atol=1e-9)
    lifted = PANDA_START.copy()
    lifted[[1, 3]] += [-0.2, 0.3]
    goal = joint_goal(panda.arm.joints, lifted[:7])
    assert panda.plan(request(goal, group_name="panda_arm")).code == ErrorCode.SUCCESS
    # Only the end of the rod touches the block at the goal.
    tip = panda.arm.robot.forward_kinematics(lifted) @ at(0.0, 0.0, 0.32)
    panda.apply_scene(difference(thing("block", primitive(1, 0.05, 0.05, 0.05), at(*tip[:3, 3]))))
    refused = panda.plan(request(goal, group_name="panda_arm"))
    assert refused.code == ErrorCode.GOAL_IN_COLLISION
    assert "rod" in refused.message
    assert "block" in refused.message
    # A start state without attached objects that is no difference releases the rod, as in MoveIt.
    names = panda.arm.robot.joint_names
    joints = make("sensor_msgs/msg/JointState", name=names, position=PANDA_START)
    start = make("moveit_msgs/msg/RobotState", joint_state=joints)
    assert panda.plan(request(goal, group_name="panda_arm", start_state=start)).code == ErrorCode.SUCCESS
    panda.apply_scene(attach("", thing("rod", operation=REMOVE)))
    np.testing.assert_allclose(panda.world.items["rod"].pose, inside, atol=1e-9)


def test_one_message_attaches_or_detaches_as_in_the_tutorials_of_moveit(panda: Planner) -> None:
    box = thing("box", primitive(1, 0.1, 0.1, 0.1), at(0.4, 0.0, 0.6))
    panda.apply_scene(difference(box))
    taking = difference(thing("box", operation=REMOVE), robot_state=attach("panda_hand", thing("box")).robot_state)
    panda.apply_scene(taking)
    assert panda.world.items["box"].link == "panda_hand"
    moved = thing("box", primitive(1, 0.1, 0.1, 0.1), FAR)
    for link in ("panda_hand", ""):
        panda.apply_scene(taking)
        releasing = attach(link, thing("box", operation=REMOVE)).robot_state
        panda.apply_scene(difference(moved, robot_state=releasing))
        assert panda.world.items["box"].link is None
        np.testing.assert_allclose(panda.world.items["box"].pose, FAR, atol=1e-12)


def test_a_state_without_joints_keeps_the_attached_objects(panda: Planner) -> None:
    ball = primitive(2, 0.02)
    for name in "ab":
        scene = attach("panda_hand", thing(name, ball, header=header("panda_hand")))
        scene.robot_state.is_diff = False
        panda.apply_scene(scene)
    assert list(panda.world.items) == ["a", "b"]
    panda.apply_scene(message("moveit_msgs/msg/PlanningScene", is_diff=False))
    assert list(panda.world.items) == ["a", "b"]
    state = make("sensor_msgs/msg/JointState", name=["panda_joint1"], position=[0.0])
    whole = make("moveit_msgs/msg/RobotState", joint_state=state)
    panda.apply_scene(message("moveit_msgs/msg/PlanningScene", robot_state=whole))
    assert not panda.world.items


def matrix(names: list[str], allowed: set[tuple[str, str]], **fields: Any) -> Any:
    rows = [
        make("moveit_msgs/msg/AllowedCollisionEntry", enabled=[(a, b) in allowed or (b, a) in allowed for b in names])
        for a in names
    ]
    return make("moveit_msgs/msg/AllowedCollisionMatrix", entry_names=names, entry_values=rows, **fields)


def test_the_collision_matrix_frees_objects_and_must_not_forbid_unchecked_pairs(panda: Planner) -> None:
    links = [*panda.arm.robot.link_names]
    disabled = set(panda.arm.unchecked)
    hand = panda.arm.robot.forward_kinematics(PANDA_START)
    curtain = thing("curtain", primitive(2, 0.05), hand)
    # MoveIt sends a matrix of all links in which the pairs of the SRDF are allowed.
    panda.apply_scene(difference(curtain, allowed_collision_matrix=matrix(links, disabled)))
    assert panda.world.scene(PANDA_START).in_collision(PANDA_START)
    some = {("curtain", "panda_hand")}
    panda.apply_scene(difference(allowed_collision_matrix=matrix([*links, "curtain"], disabled | some)))
    assert panda.world.scene(PANDA_START).in_collision(PANDA_START)
    free = {"default_entry_names": ["curtain"], "default_entry_values": [True]}
    panda.apply_scene(difference(allowed_collision_matrix=matrix(links, disabled, **free)))
    assert not panda.world.scene(PANDA_START).in_collision(PANDA_START)
    with pytest.raises(RefusedError, match="forbids contacts of") as refused:
        panda.apply_scene(difference(allowed_collision_matrix=matrix(links, disabled - {panda.arm.unchecked[3]})))
    assert refused.value.code == ErrorCode.COLLISION_CHECKING_UNAVAILABLE


def test_entries_of_the_matrix_come_before_defaults_which_are_combined() -> None:
    built = matrix(["a", "b"], {("a", "b")}, default_entry_names=["a", "c"], default_entry_values=[False, True])
    allowed = AllowedCollisions.from_message(built, "matrix")
    asked = [allowed.allows(*pair) for pair in (("a", "b"), ("b", "a"), ("a", "x"), ("c", "x"), ("a", "c"), ("x", "y"))]
    assert asked == [True, True, False, True, False, None]


def octomap(data: str, binary: bool, **fields: Any) -> Any:
    values = {"id": "OcTree", "resolution": 0.05, "binary": binary, "data": np.frombuffer(bytes.fromhex(data), np.int8)}
    return make("octomap_msgs/msg/Octomap", **{**values, **fields})


@pytest.mark.parametrize(("data", "binary"), [(FULL, False), (BINARY, True)], ids=["full", "binary"])
def test_an_octomap_has_the_cells_that_octomap_lists(data: str, binary: bool) -> None:
    centres, sides = occupied_cells(octomap(data, binary))
    found = sorted(map(tuple, np.column_stack([centres, sides]).round(6).tolist()))
    np.testing.assert_allclose(found, sorted(LEAVES), atol=1e-6)
    with pytest.raises(RefusedError, match="in the middle of the tree"):
        occupied_cells(octomap(data[:-20], binary))
    with pytest.raises(RefusedError, match="'ColorOcTree' cannot be read"):
        occupied_cells(octomap(data, binary, id="ColorOcTree"))


def test_an_octomap_is_an_obstacle(planner: Planner) -> None:
    origin = at(0.1, 0.2, -0.3, [0.0, 0.0, 0.7])
    placed = make("octomap_msgs/msg/OctomapWithPose", origin=pose(origin), octomap=octomap(FULL, False))
    world = make("moveit_msgs/msg/PlanningSceneWorld", octomap=placed)
    planner.apply_scene(difference(world=world))
    (body,) = planner.world.scene(START).bodies
    np.testing.assert_allclose(body.pose, origin, atol=1e-12)
    cubes = body.surface()[0].reshape(-1, 36, 3)
    found = [(*((cube.min(axis=0) + cube.max(axis=0)) / 2), *np.ptp(cube, axis=0)) for cube in cubes]
    wanted = [(*leaf[:3], *[leaf[3]] * 3) for leaf in LEAVES]
    np.testing.assert_allclose(sorted(np.round(found, 6).tolist()), sorted(wanted), atol=1e-6)
    # Cells that no arm can reach are left out.
    world.octomap.octomap.resolution = 1e300
    planner.apply_scene(difference(world=world))
    assert not planner.world.scene(START).bodies
    # move_group sends this when the octomap was cleared.
    world.octomap.octomap.resolution = 0.05
    planner.apply_scene(difference(world=world))
    assert planner.world.scene(START).bodies
    world.octomap.octomap = make("octomap_msgs/msg/Octomap", id="cleared")
    planner.apply_scene(difference(world=world))
    assert not planner.world.scene(START).bodies


def cloud(points: np.ndarray, *, big: bool = False, kind: int = 7, frame: str = "") -> Any:
    """Return a PointCloud2 of 2 rows with padding, whose fields are not in the order x, y, z."""
    order = ">" if big else "<"
    number = {7: "f4", 8: "f8"}[kind]
    size = np.dtype(number).itemsize
    row = np.dtype(
        {
            "names": ["z", "x", "y"],
            "formats": [order + number] * 3,
            "offsets": [0, size + 4, 2 * size + 4],
            "itemsize": 4 * size + 8,
        }
    )
    data = np.zeros(len(points), row)
    data["x"], data["y"], data["z"] = points.T
    rows = data.tobytes()
    step, width = row.itemsize, len(points) // 2
    padded = b"".join(rows[k * width * step : (k + 1) * width * step] + b"padding" for k in range(2))
    fields = [
        make("sensor_msgs/msg/PointField", name=n, offset=row.fields[n][1], datatype=kind, count=1) for n in row.names
    ]
    sizes = {"height": 2, "width": width, "point_step": step, "row_step": width * step + 7}
    values = {"header": header(frame), "fields": fields, "is_bigendian": big, "data": np.frombuffer(padded, np.uint8)}
    return message("sensor_msgs/msg/PointCloud2", **values, **sizes)


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("kind", [7, 8])
def test_points_are_read_with_any_layout(big: bool, kind: int) -> None:
    points = np.random.default_rng(3).normal(size=(10, 3))
    points[4, 1] = np.nan
    found = cloud_points(cloud(points, big=big, kind=kind))
    np.testing.assert_allclose(found, np.delete(points, 4, axis=0), atol=1e-6)


def test_a_cloud_is_an_obstacle_without_the_robot(planner: Planner) -> None:
    robot = planner.arm.robot
    flange = robot.forward_kinematics(START, "wrist_3_link")[:3, 3]
    strays = [[1500.0, 0.0, 0.0], [0.0, 1e30, 0.0]]
    seen = np.array([[0.5, 0.0, z] for z in np.linspace(0.1, 0.9, 30)] + [flange, flange, *strays])
    frame = robot.forward_kinematics(START, "wrist_1_link")
    planner.set_cloud(cloud(in_frame(seen, frame), kind=8, frame="wrist_1_link"), 0.02)
    (body,) = planner.world.scene(START).bodies
    spheres = body.surface()[1]
    np.testing.assert_allclose(spheres[:, :3], seen[:30], atol=1e-6)
    np.testing.assert_allclose(spheres[:, 3], 0.02)
    planner.set_cloud(cloud(np.array(strays), kind=8), 0.02)
    assert not planner.world.scene(START).bodies


def test_what_the_solver_cannot_do_is_refused_and_changes_nothing(panda: Planner) -> None:
    panda.apply_scene(difference(thing("known", primitive(2, 0.1), FAR)))
    before = panda.world
    box = primitive(1, 0.1, 0.1, 0.1)
    lost = make("geometry_msgs/msg/Pose", position=make("geometry_msgs/msg/Point", x=1e200))
    huge = make("octomap_msgs/msg/OctomapWithPose", octomap=octomap(FULL, False, resolution=5e3))
    huge.origin = pose(at(-5e4, -1e4, -1e4))
    bad = {
        "'panda_link3' is a link of the robot": difference(thing("panda_link3", box)),
        "'<cloud>' is a reserved name": difference(thing("<cloud>", box)),
        "'<octomap>' is a reserved name": attach("panda_hand", thing("<octomap>", box)),
        "object 'it': .*within 1000 m": difference(thing("it", box, pose=lost)),
        "object 'known': .*within 1000 m": difference(thing("known", pose=lost, operation=MOVE)),
        "octomap.octomap: .*within 1000 m": difference(world=make("moveit_msgs/msg/PlanningSceneWorld", octomap=huge)),
        "'box2' to move": difference(thing("box2", operation=MOVE)),
        "must hold 3 lengths": difference(thing("it", primitive(1, 0.1, -0.1, 0.1))),
        "9 is no primitive": difference(thing("it", primitive(9, 0.1))),
        "convex polygon": difference(thing("it", primitive(5, 0.1, corners=[(0, 0), (1, 0), (0.1, 0.1), (0, 1)]))),
        "neither primitives": difference(thing("it")),
        "2 poses for 1": difference(thing("it", box, primitive_poses=[pose(FAR), pose(FAR)])),
        "'map' is no link": difference(thing("it", box, header=header("map"))),
        "length 2": difference(
            thing(
                "it", box, pose=make("geometry_msgs/msg/Pose", orientation=make("geometry_msgs/msg/Quaternion", w=2.0))
            )
        ),
        "relative to the hand": attach("panda_link3", thing("known")),
        "no link 'gripper'": attach("gripper", thing("known")),
        "no object 'new'": attach("panda_hand", thing("new")),
        "set the planner's margin": difference(
            link_padding=[make("moveit_msgs/msg/LinkPadding", link_name="panda_hand", padding=0.01)]
        ),
        "another robot": difference(robot_model_name="ur5e"),
        "no square matrix": difference(
            allowed_collision_matrix=make("moveit_msgs/msg/AllowedCollisionMatrix", entry_names=["a"])
        ),
    }
    for text, scene in bad.items():
        with pytest.raises(RefusedError, match=text):
            panda.apply_scene(scene)
        assert panda.world is before, text


def test_fields_of_type_byte_may_be_bytes_as_in_rclpy(planner: Planner) -> None:
    scene = make("moveit_msgs/msg/PlanningScene", is_diff=True)
    scene.world.collision_objects.append(thing("a", primitive(2, 0.1), FAR))
    scene.world.collision_objects[0].operation = b"\x00"
    planner.apply_scene(scene)
    scene.world.collision_objects[0].operation = b"\x01"
    planner.apply_scene(scene)
    assert not planner.world.items

"""Motion plan requests of MoveIt, serialized as ROS 2 does, and their answers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio
import pytest
from gensim2_ros import Answer, ErrorCode, Planner, RefusedError, motion_plan_response
from gensim2_ros.planner import CODES
from scipy.spatial.transform import Rotation

import gensim2_kpam as kpam

from .ros_messages import make, store
from .ros_requests import (
    GOAL,
    START,
    UR5E,
    at,
    difference,
    header,
    joint_goal,
    joint_state,
    orientation,
    pose_goal,
    position,
    primitive,
    request,
    thing,
    ur5e_planner,
)

POST = thing("post", primitive(1, 0.1, 0.1, 1.0), at(0.5, 0.0, 0.5))
RESPONSE = "moveit_msgs/msg/MotionPlanResponse"


@pytest.fixture
def planner() -> Planner:
    planner = ur5e_planner()
    planner.apply_scene(difference(POST))
    return planner


@pytest.fixture
def goal(planner: Planner) -> Any:
    return joint_goal(planner.arm.joints, GOAL)


def placement(q: Any, link: str = "flange") -> np.ndarray:
    """Return the pose (4, 4) of a link as Pinocchio computes it."""
    model = pinocchio.buildModelFromUrdf(str(UR5E))
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, np.asarray(q, dtype=float))
    return np.asarray(data.oMf[model.getFrameId(link)].homogeneous)


def end(answer: Answer) -> np.ndarray:
    assert answer.trajectory is not None, answer.message
    return np.asarray(answer.trajectory.positions[-1])


def response(planner: Planner, answer: Answer, time_step: float = 0.01) -> Any:
    """Return the response of an answer after it was serialized and read again."""
    written = store().serialize_cdr(motion_plan_response(planner.arm, answer, time_step, make), RESPONSE)
    return store().deserialize_cdr(bytes(written), RESPONSE)


def test_a_joint_goal_is_answered_with_a_timed_trajectory(planner: Planner, goal: Any) -> None:
    answer = planner.plan(request(goal))
    found = response(planner, answer)
    assert (found.error_code.val, found.error_code.source, found.group_name) == (1, "gensim2", "manipulator")
    assert 0.0 < found.planning_time < 20.0
    np.testing.assert_allclose(found.trajectory_start.joint_state.position, START)
    trajectory = found.trajectory.joint_trajectory
    assert trajectory.header.frame_id == "base_link"
    assert trajectory.joint_names == list(planner.arm.joints)
    times = np.array([p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in trajectory.points])
    q, v, a = (
        np.array([getattr(p, k) for p in trajectory.points]) for k in ("positions", "velocities", "accelerations")
    )
    assert times[0] == 0.0
    assert 0.0 < np.diff(times).min() <= np.diff(times).max() <= 0.01 + 1e-9
    np.testing.assert_allclose(q[[0, -1]], [START, GOAL], atol=1e-9)
    assert not v[[0, -1]].any()
    # The jerk limit of 100 rad/s^3 bounds the error of the trapezoidal rule by 2 * 100 * 0.01^2 / 8.
    step = np.diff(times)[:, None]
    np.testing.assert_allclose(np.diff(q, axis=0), step * (v[1:] + v[:-1]) / 2, atol=1e-4)
    np.testing.assert_allclose(np.diff(v, axis=0), step * (a[1:] + a[:-1]) / 2, atol=2.5e-3)
    assert (np.abs(v) <= planner.arm.robot.velocity + 1e-9).all()
    assert np.abs(a).max() <= 5.0 + 1e-9
    assert not planner.world.scene(START).in_collision(q).any()
    straight = START + np.linspace(0.0, 1.0, 50)[:, None] * (GOAL - START)
    assert planner.world.scene(START).in_collision(straight).any()


def test_scaling_slows_the_motion_down(planner: Planner, goal: Any) -> None:
    fast = planner.plan(request(goal)).trajectory
    slow = planner.plan(request(goal, max_velocity_scaling_factor=0.1, max_acceleration_scaling_factor=0.5)).trajectory
    assert fast is not None
    assert slow is not None
    velocity = slow.sample(np.linspace(0.0, slow.duration, 500))[1]
    assert (np.abs(velocity) <= 0.1 * planner.arm.robot.velocity + 1e-9).all()
    assert slow.duration > 2.0 * fast.duration


def test_a_pose_goal_is_reached_with_its_offset_and_frames(planner: Planner) -> None:
    wanted = placement(GOAL)
    tip = wanted[:3, :3] @ [0.0, 0.0, 0.1] + wanted[:3, 3]
    planner.apply_scene(
        difference(thing("fixture", primitive(1, 0.01, 0.01, 0.01), at(-0.6, 0.2, 0.1, [0.1, 0.2, 0.3])))
    )
    frame = at(-0.6, 0.2, 0.1, [0.1, 0.2, 0.3])
    local, turn = np.linalg.solve(frame, [*tip, 1.0])[:3], frame[:3, :3].T @ wanted[:3, :3]
    answer = planner.plan(
        request(
            pose_goal(
                [position("flange", local, offset=(0, 0, 0.1), frame="fixture")],
                [orientation("flange", turn, (0.01, 0.01, 0.01), frame="fixture")],
            )
        )
    )
    np.testing.assert_allclose(placement(end(answer)), wanted, atol=1e-5)


@pytest.mark.parametrize("free", ["z", "x", "y", "xy", "xyz", "position"])
def test_free_rotations_are_used(planner: Planner, free: str) -> None:
    wanted, offset = at(0.4, 0.5, 0.1, [0.69, -0.7, 2.98]), (0.2, 0.2, 0.2)
    place = position("flange", wanted[:3, 3], offset=offset)
    exact = orientation("flange", wanted[:3, :3], (0.01,) * 3)
    assert planner.plan(request(pose_goal([place], [exact]))).code == ErrorCode.NO_IK_SOLUTION
    tolerances = [3.14 if axis in free else 0.01 for axis in "xyz"]
    turning = [] if free == "position" else [orientation("flange", wanted[:3, :3], tolerances)]
    reached = placement(end(planner.plan(request(pose_goal([place], turning)))))
    np.testing.assert_allclose(reached[:3, :3] @ offset + reached[:3, 3], wanted[:3, 3], atol=1e-5)
    if turning:
        assert (np.abs(euler(wanted[:3, :3].T @ reached[:3, :3])) <= np.array(tolerances) + 2e-3).all()


def euler(turn: np.ndarray) -> np.ndarray:
    """Return intrinsic XYZ Euler angles, as OrientationConstraint measures errors."""
    return np.asarray(Rotation.from_matrix(turn).as_euler("XYZ"))


def test_the_best_of_several_goals_is_taken(planner: Planner, goal: Any) -> None:
    blocked = planner.world.scene(START).ik(at(0.5, 0.0, 0.5, [0.0, np.pi, 0.0]), START)[0]
    inside = joint_goal(planner.arm.joints, blocked)
    assert planner.plan(request(inside)).code == ErrorCode.GOAL_IN_COLLISION
    np.testing.assert_allclose(end(planner.plan(request(inside, goal))), GOAL, atol=1e-6)
    some = placement([0.9, -1.0, 1.3, -1.9, -1.6, 0.3])
    poses = pose_goal([position("flange", some[:3, 3])], [orientation("flange", some[:3, :3], (0.01,) * 3)])
    np.testing.assert_allclose(placement(end(planner.plan(request(inside, poses)))), some, atol=1e-5)


def test_a_goal_of_some_joints_keeps_the_others(planner: Planner) -> None:
    answer = planner.plan(request(joint_goal(["wrist_3_joint"], [1.0])))
    np.testing.assert_allclose(end(answer), [*START[:5], 1.0], atol=1e-9)


@pytest.mark.parametrize(
    ("tolerances", "vector"),
    [((0.3, 0.3, 3.14), False), ((0.4, 0.3, 4.0), True), ((0.4, 0.4, 0.4), False)],
    ids=["free z", "free rotation vector", "none free"],
)
def test_orientation_is_kept_along_the_path(planner: Planner, tolerances: tuple[float, ...], vector: bool) -> None:
    # Pairs of start and goal with the same orientation, up to the rotation about z where z is free.
    scene = planner.world.scene(START)
    down = placement(START)
    ends = [at(0.5, side * 0.35, 0.3) for side in (1.0, -1.0)]
    for each in ends:
        each[:3, :3] = down[:3, :3]
    if tolerances[2] > 3.0:
        ends[1][:3, :3] @= Rotation.from_rotvec([0.0, 0.0, 0.8]).as_matrix()
    start = scene.ik(ends[0], START, max_solutions=1, margin=0.005)[0]
    keep = orientation("flange", down[:3, :3], tolerances, vector=vector)
    path = make("moveit_msgs/msg/Constraints", orientation_constraints=[keep])
    goal = pose_goal([position("flange", ends[1][:3, 3])], [orientation("flange", ends[1][:3, :3], (0.01,) * 3)])
    planner.set_joints(joint_state(planner.arm.joints, start))
    answer = planner.plan(request(goal, path_constraints=path))
    assert answer.trajectory is not None, answer.message
    q = answer.trajectory.sample(np.linspace(0.0, answer.trajectory.duration, 300))[0]
    errors = [down[:3, :3].T @ placement(row)[:3, :3] for row in q]
    kind = Rotation.from_matrix(errors)
    off = np.abs(kind.as_rotvec() if vector else kind.as_euler("XYZ"))
    assert (off.max(axis=0) <= np.array(tolerances) + 1e-6).all(), off.max(axis=0)


def test_frames_of_path_constraints_must_not_move(planner: Planner, goal: Any) -> None:
    inner = thing("tool", primitive(2, 0.01), header=header("flange"))
    held = make("moveit_msgs/msg/AttachedCollisionObject", link_name="flange", object=inner)
    state = make("moveit_msgs/msg/RobotState", attached_collision_objects=[held], is_diff=True)
    planner.apply_scene(difference(robot_state=state))
    for frame in ("wrist_1_link", "/wrist_1_link", "tool", "/tool"):
        keep = orientation("flange", np.eye(3), (0.3, 0.3, 4.0), frame=frame)
        path = make("moveit_msgs/msg/Constraints", orientation_constraints=[keep])
        answer = planner.plan(request(goal, path_constraints=path))
        assert answer.code == ErrorCode.PLANNING_FAILED
        assert "moves; use a frame" in answer.message


def test_goals_with_free_rotations_may_be_as_close_to_obstacles_as_others(planner: Planner) -> None:
    # A ball on the axis of the last joint, 2.8 mm in front of the wrist at the goal; the margin is 5 mm.
    flange = placement(GOAL)
    planner.apply_scene(difference(thing("ball", primitive(2, 0.02), flange @ at(0.0, 0.0, 0.023))))
    pairs = planner.world.scene(START).check(GOAL, 0.004)
    assert [pair["distance"] for pair in pairs if "ball" in pair["bodies"]] == [pytest.approx(0.0028)]
    for free in (0.01, 3.14):
        turning = [orientation("flange", flange[:3, :3], (0.01, 0.01, free))]
        answer = planner.plan(request(pose_goal([position("flange", flange[:3, 3])], turning)))
        assert answer.code == ErrorCode.SUCCESS, answer.message


def test_a_start_slightly_beyond_a_limit_is_moved_to_the_limit(planner: Planner, goal: Any) -> None:
    upper = planner.arm.robot.upper[5]
    for beyond, code in ((0.0008, ErrorCode.SUCCESS), (0.01, ErrorCode.START_STATE_INVALID)):
        planner.set_joints(joint_state(["wrist_3_joint"], [upper + beyond]))
        answer = planner.plan(request(goal))
        assert answer.code == code, answer.message
        if answer.trajectory is not None:
            assert answer.trajectory.positions[0, 5] == answer.q_start[5] == upper


def test_joints_of_other_robots_and_messages_without_positions_are_ignored(planner: Planner) -> None:
    before = planner.joints
    planner.set_joints(joint_state(["gripper_joint", "elbow_joint"], [np.nan, 1.4]))
    assert planner.joints == {**before, "elbow_joint": 1.4}
    planner.set_joints(joint_state(["elbow_joint"], []))
    assert planner.joints == {**before, "elbow_joint": 1.4}
    with pytest.raises(RefusedError, match="must be finite, one for each of the 1 names"):
        planner.set_joints(joint_state(["elbow_joint"], [np.nan]))


def test_a_start_state_and_its_velocity_are_taken(planner: Planner, goal: Any) -> None:
    names, values, speed = ["elbow_joint"], [1.6], [0.5]
    state = make("sensor_msgs/msg/JointState", name=names, position=values, velocity=speed)
    start = make("moveit_msgs/msg/RobotState", joint_state=state, is_diff=True)
    found = response(planner, planner.plan(request(goal, start_state=start)))
    first = found.trajectory.joint_trajectory.points[0]
    np.testing.assert_allclose(first.positions, [*START[:2], 1.6, *START[3:]])
    np.testing.assert_allclose(first.velocities, [0, 0, 0.5, 0, 0, 0], atol=1e-9)
    slow = make("sensor_msgs/msg/JointState", name=names, position=values, velocity=[0.005])
    start = replace(start, joint_state=slow)
    found = response(planner, planner.plan(request(goal, start_state=start)))
    assert not found.trajectory.joint_trajectory.points[0].velocities.any()


def _refusals() -> dict[str, tuple[dict[str, Any], ErrorCode, str]]:
    """Return changes of a request that the planner refuses, with the code and a part of the message."""
    q = {"name": ["elbow_joint"], "position": [7.0]}
    outside = make("moveit_msgs/msg/RobotState", joint_state=make("sensor_msgs/msg/JointState", **q), is_diff=True)
    other = make(
        "moveit_msgs/msg/RobotState", joint_state=make("sensor_msgs/msg/JointState", name=["a"], position=[0.0])
    )
    constraints, at_tip = "moveit_msgs/msg/Constraints", position("flange", (0.4, 0.4, 0.4))
    turned = orientation("flange", np.eye(3), (0.1, 0.1, 0.1))
    code = ErrorCode
    return {
        "group": ({"group_name": "left_arm"}, code.INVALID_GROUP_NAME, "use 'manipulator'"),
        "planner": ({"planner_id": "RRTConnect"}, code.PLANNING_FAILED, "planner_id: 'RRTConnect'"),
        "scale": ({"max_velocity_scaling_factor": 1.5}, code.PLANNING_FAILED, "max_velocity_scaling_factor"),
        "cartesian speed": ({"max_cartesian_speed": 0.2}, code.PLANNING_FAILED, "max_cartesian_speed"),
        "start outside": ({"start_state": outside}, code.START_STATE_INVALID, "elbow_joint: 7"),
        "unknown joint": ({"start_state": other}, code.INVALID_ROBOT_STATE, "no joint 'a'"),
        "no goal": ({"goal_constraints": []}, code.INVALID_GOAL_CONSTRAINTS, "goal_constraints"),
        "empty goal": ({"goal_constraints": [make(constraints)]}, code.UNRECOGNIZED_GOAL_TYPE, "goal_constraints[0]"),
        "unknown goal joint": (
            {"goal_constraints": [joint_goal(["a"], [0.0])]},
            code.INVALID_GOAL_CONSTRAINTS,
            "joint_constraints[0].joint_name",
        ),
        "goal outside": (
            {"goal_constraints": [joint_goal(["elbow_joint"], [7.0])]},
            code.GOAL_STATE_INVALID,
            "elbow_joint: 7",
        ),
        "unreachable": (
            {"goal_constraints": [pose_goal([position("flange", (3, 0, 0))], [turned])]},
            code.NO_IK_SOLUTION,
            "no joint values",
        ),
        "all in the post": (
            {"goal_constraints": [pose_goal([position("flange", (0.5, 0, 0.5))])]},
            code.GOAL_IN_COLLISION,
            "collision",
        ),
        "link": ({"goal_constraints": [pose_goal([position("x", (0, 0, 0))])]}, code.INVALID_LINK_NAME, "'x'"),
        "frame": (
            {"goal_constraints": [pose_goal([position("flange", (0, 0, 0), frame="map")])]},
            code.FRAME_TRANSFORM_FAILURE,
            "'map'",
        ),
        "path of positions": (
            {"path_constraints": make(constraints, position_constraints=[at_tip])},
            code.PLANNING_FAILED,
            "path_constraints.position_constraints",
        ),
        "start off the path": (
            {"path_constraints": make(constraints, orientation_constraints=[turned])},
            code.START_STATE_VIOLATES_PATH_CONSTRAINTS,
            "start_state",
        ),
        "no time": ({"allowed_planning_time": 1e-6}, code.TIMED_OUT, "deadline"),
        "trajectory constraints": (
            {"trajectory_constraints": make("moveit_msgs/msg/TrajectoryConstraints", constraints=[make(constraints)])},
            code.PLANNING_FAILED,
            "trajectory_constraints",
        ),
    }


@pytest.mark.parametrize("case", _refusals())
def test_requests_are_refused_with_code_and_field(planner: Planner, goal: Any, case: str) -> None:
    changes, code, text = _refusals()[case]
    answer = planner.plan(request(**{"goal_constraints": [goal], **changes}))
    found = response(planner, answer)
    assert ErrorCode(found.error_code.val) == code, answer.message
    assert text in found.error_code.message
    assert found.trajectory.joint_trajectory.points == []


def test_a_start_in_collision_is_refused(planner: Planner, goal: Any) -> None:
    blocked = planner.world.scene(START).ik(at(0.5, 0.0, 0.5, [0.0, np.pi, 0.0]), START)[0]
    planner.set_joints(joint_state(planner.arm.joints, blocked))
    answer = planner.plan(request(goal))
    assert answer.code == ErrorCode.START_STATE_IN_COLLISION
    assert "post" in answer.message
    inside = planner.plan(request(pose_goal([position("flange", (0.5, 0.0, 0.5))])))
    assert inside.code == ErrorCode.START_STATE_IN_COLLISION
    assert "post" in inside.message


def test_joints_must_be_known(goal: Any) -> None:
    planner = Planner(ur5e_planner().arm)
    answer = planner.plan(request(goal))
    assert answer.code == ErrorCode.INVALID_ROBOT_STATE
    assert "wrist_3_joint" in answer.message


def test_codes_are_those_of_moveit_and_cover_every_status() -> None:
    assert set(CODES) == set(kpam.MotionStatus)
    weak = ur5e_planner(torque_limits=[1.0] * 6)
    assert weak.plan(request(joint_goal(weak.arm.joints, GOAL))).code == ErrorCode.PLANNING_FAILED
    codes = store().types["moveit_msgs/msg/MoveItErrorCodes"]
    assert {code.name: code.value for code in ErrorCode} == {code.name: getattr(codes, code.name) for code in ErrorCode}

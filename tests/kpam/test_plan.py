"""Whole plans: solved ones keep their promises, and failures give their reason."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import numpy as np
import pytest
from constraints import point_to_point
from scipy.spatial.transform import Rotation

import gensim2_kpam as kpam

from .kpam_scenes import Q_START, TOOL, config, problem, table


def hand_path(panda: kpam.Robot, plan: kpam.Plan, start: str, end: str) -> np.ndarray:
    """Return hand poses between two keyframes, (N, 4, 4)."""
    times = {frame["label"]: frame["time"] for frame in plan.keyframes}
    assert plan.trajectory is not None
    samples = [plan.trajectory.sample(t)[0] for t in np.linspace(times[start], times[end], 60)]
    return panda.forward_kinematics(np.array(samples))


def test_the_whole_motion(panda: kpam.Robot) -> None:
    plan = kpam.plan(problem(panda))
    assert plan.status == "solved", plan.reason
    assert plan.trajectory is not None
    assert plan.q_plan is not None
    assert all(entry["satisfied"] for entry in plan.residuals)
    assert len(plan.residuals) == 3
    np.testing.assert_array_equal(plan.trajectory.positions[0], Q_START)
    hand = panda.forward_kinematics(plan.q_plan)
    tip = hand[:3, :3] @ TOOL["tool_head"] + hand[:3, 3]
    assert np.abs(tip - [0.5, 0.1, 0.2]).max() <= 0.001
    assert [frame["label"] for frame in plan.keyframes] == ["pre_0", "actuation", "post_0", "post_1"]
    for frame in plan.keyframes:
        assert frame["reached"]
        assert np.isclose(plan.trajectory.times, frame["time"], atol=1e-12).any()
        there = panda.forward_kinematics(plan.trajectory.sample(frame["time"])[0])
        np.testing.assert_allclose(there, frame["T_base_hand"], atol=1e-5)
    # pre: 0.1 m back along the hand's z; post: 0.05 m back along it, then 0.06 m up.
    act = plan.keyframes[1]["T_base_hand"]
    np.testing.assert_allclose(plan.keyframes[0]["T_base_hand"][:3, 3], act[:3, 3] - 0.1 * act[:3, 2], atol=1e-9)
    back = act[:3, 3] - 0.05 * act[:3, 2]
    np.testing.assert_allclose(plan.keyframes[2]["T_base_hand"][:3, 3], back, atol=1e-9)
    np.testing.assert_allclose(plan.keyframes[3]["T_base_hand"][:3, 3], back + np.array([0, 0, 0.06]), atol=1e-9)


def test_pre_actuation_motions_chain_outwards_from_the_actuation(panda: kpam.Robot) -> None:
    settings = config(
        pre_actuation_motions=[["translate_z", -0.04], "move-up", ["translate_x", 0.05]],
        pre_actuation_times=[6, 8, 9],
        actuation_time=10,
        post_actuation_times=[12, 14],
    )
    plan = kpam.plan(problem(panda, config=settings))
    assert plan.status == "solved", plan.reason
    labels = [frame["label"] for frame in plan.keyframes]
    assert labels == ["pre_2", "pre_1", "pre_0", "actuation", "post_0", "post_1"]
    assert [frame["time"] for frame in plan.keyframes] == pytest.approx([6, 8, 9, 10, 12, 14])
    origins = {frame["label"]: frame["T_base_hand"][:3, 3] for frame in plan.keyframes}
    axes = plan.keyframes[3]["T_base_hand"][:3, :3]
    np.testing.assert_allclose(origins["pre_0"], origins["actuation"] - 0.04 * axes[:, 2], atol=1e-9)
    np.testing.assert_allclose(origins["pre_1"], origins["pre_0"] + [0, 0, 0.06], atol=1e-9)
    np.testing.assert_allclose(origins["pre_2"], origins["pre_1"] + 0.05 * axes[:, 0], atol=1e-9)


def test_translations_are_straight_and_limits_hold(panda: kpam.Robot) -> None:
    plan = kpam.plan(problem(panda))
    path = hand_path(panda, plan, "pre_0", "actuation")[:, :3, 3]
    along = (path[-1] - path[0]) / np.linalg.norm(path[-1] - path[0])
    off = (path - path[0]) - np.outer((path - path[0]) @ along, along)
    assert np.linalg.norm(off, axis=1).max() < 1e-3
    assert plan.trajectory is not None
    acceleration = np.array([15, 7.5, 10, 12.5, 15, 20, 20])
    for t in np.linspace(0, plan.trajectory.duration, 400):
        q, v, a = plan.trajectory.sample(t)
        assert (q[:7] >= panda.lower[:7]).all()
        assert (q[:7] <= panda.upper[:7]).all()
        assert (np.abs(v[:7]) <= 0.5 * panda.velocity[:7] + 1e-9).all()
        assert (np.abs(a[:7]) <= 0.5 * acceleration + 1e-9).all()
        assert (q[7:] == 0.04).all()


def test_following_the_joint_is_an_arc(panda: kpam.Robot) -> None:
    settings = config(post_actuation_motions=[["follow_joint_to", 0.4]])
    plan = kpam.plan(problem(panda, config=settings))
    assert plan.status == "solved", plan.reason
    turn = 0.4 * 1.5 - 0.2
    act, end = (plan.keyframes[index]["T_base_hand"] for index in (1, 2))
    about = np.eye(4)
    about[:3, :3] = Rotation.from_rotvec([turn, 0, 0]).as_matrix()
    shift = np.array([0.5, 0.3, 0.1])
    about[:3, 3] = shift - about[:3, :3] @ shift
    np.testing.assert_allclose(end, about @ act, atol=1e-9)
    radius = np.linalg.norm((hand_path(panda, plan, "actuation", "post_0")[:, :3, 3] - shift)[:, 1:], axis=1)
    # The motion passes the actuation pose without a stop and leaves the arc by at most 2 mm there.
    assert np.abs(radius - radius[-1]).max() < 2e-3


def test_tracing_the_joint_keeps_the_orientation(panda: kpam.Robot) -> None:
    settings = config(post_actuation_motions=[["trace_joint", 0.3]])
    plan = kpam.plan(problem(panda, config=settings))
    assert plan.status == "solved", plan.reason
    act, end = (plan.keyframes[index]["T_base_hand"] for index in (1, 2))
    np.testing.assert_allclose(act[:3, :3], end[:3, :3], atol=1e-9)
    before, after = (pose[:3, :3] @ TOOL["tool_head"] + pose[:3, 3] - [0.5, 0.3, 0.1] for pose in (act, end))
    np.testing.assert_allclose(after, Rotation.from_rotvec([0.3, 0, 0]).apply(before), atol=1e-9)


def test_the_configs_clock(panda: kpam.Robot) -> None:
    settings = config(actuation_time=10, pre_actuation_times=[6], post_actuation_times=[12, 14])
    plan = kpam.plan(problem(panda, config=settings, options={"start_time": 1.0}))
    assert plan.status == "solved", plan.reason
    assert [frame["time"] for frame in plan.keyframes] == pytest.approx([6, 10, 12, 14])
    assert plan.trajectory is not None
    assert plan.trajectory.times[0] == 1.0
    hurried = kpam.plan(problem(panda, config=settings, options={"start_time": 5.99}))
    assert hurried.status == "too_fast"
    assert "pre_0" in hurried.reason
    assert hurried.trajectory is None


def test_the_reason_begins_with_the_constraint_that_misses_its_tolerance_most(panda: kpam.Robot) -> None:
    """The axis misses more in rad than the point in m, but the point exceeds its tolerance by a larger factor."""
    given = config()
    for each in given["constraint_list"]:
        if each["type"] != "point2point_constraint":
            each["tolerance"] = 0.3
    plan = kpam.plan(problem(panda, config=given, object_keypoints={"edge": [1.2, 0.0, 0.2]}))
    assert plan.status == "actuation_infeasible"
    missed = {each["name"]: each["residual"] / each["tolerance"] for each in plan.residuals if not each["satisfied"]}
    ranked = sorted(missed, key=lambda name: -missed[name])
    assert ranked[0].startswith("point2point_constraint")
    told = plan.reason.removeprefix("no joint values meet the constraints: at best ")
    assert [part.partition(" has a residual of ")[0] for part in told.split(", and ")] == ranked
    assert told.partition("(tolerance ")[2].startswith("0.001 m)")


def test_out_of_reach_is_said(panda: kpam.Robot) -> None:
    plan = kpam.plan(problem(panda, object_keypoints={"edge": [2.0, 0.0, 0.2]}))
    assert plan.status == "actuation_infeasible"
    assert plan.q_actuation is None
    assert plan.q_best_effort is not None
    assert "point2point_constraint" in plan.reason
    assert not plan.residuals[0]["satisfied"]
    far = config(post_actuation_motions=[["translate_z", -0.05], *["move-forward"] * 8])
    whole = kpam.plan(problem(panda, config=far))
    assert whole.status == "unreachable"
    assert "m in the base frame remain; no joint is at a limit" in whole.reason
    assert whole.trajectory is None
    assert 0 < whole.reached_fraction < 1
    part = kpam.plan(problem(panda, config=far, options={"allow_partial": True}))
    assert part.status == "partial"
    assert part.trajectory is not None
    reached = [frame for frame in part.keyframes if frame["reached"]]
    assert 3 <= len(reached) < len(part.keyframes)
    end = panda.forward_kinematics(part.trajectory.positions[-1])[:3, 3]
    assert end[0] >= reached[-1]["T_base_hand"][0, 3] - 1e-6


def wall(x: float, half: tuple[float, float, float]) -> kpam.Body:
    pose = np.eye(4)
    pose[:3, 3] = [x, 0.0, half[2]]
    return kpam.Body("wall", "rigid", [kpam.Shape.box(half)], pose)


def test_goes_around_what_is_in_the_way(panda: kpam.Robot) -> None:
    target = {"edge": [0.5, -0.35, 0.15]}
    q_start = Q_START.copy()
    q_start[0] = 0.7
    obstacle = wall(0.45, (0.12, 0.02, 0.2))
    blind = kpam.plan(
        problem(
            panda,
            q_start=q_start,
            object_keypoints=target,
            bodies=[table(), obstacle],
            options={"avoid_collisions": False},
        )
    )
    assert blind.status == "solved"
    assert blind.collisions
    assert {"wall"} == {entry["bodies"][1] for entry in blind.collisions}
    scene = problem(panda, q_start=q_start, object_keypoints=target, bodies=[table(), obstacle])
    plan = kpam.plan(scene)
    assert plan.status == "solved", plan.reason
    least = kpam.min_clearance(scene, plan, 0.02)
    assert least is not None
    assert min(least.values()) > -5e-4


def test_a_blocked_goal_names_the_bodies(panda: kpam.Robot) -> None:
    pose = np.eye(4)
    pose[:3, 3] = [0.5, 0.1, 0.2]
    lid = kpam.Body("lid", "object_body", [kpam.Shape.box([0.05, 0.05, 0.05])], pose)
    plan = kpam.plan(problem(panda, bodies=[table(), lid]))
    assert plan.status == "collision"
    assert plan.trajectory is None
    assert f"lid overlap by {-1000 * plan.collisions[0]['distance']:.1f} mm" in plan.reason
    assert plan.collisions[0]["bodies"][1] == "lid"
    assert plan.collisions[0]["distance"] < 0
    # The hand may touch the moving link and its target from pre_0 on.
    for role in ("moving_link", "target"):
        free = kpam.Body("lid", role, [kpam.Shape.box([0.02, 0.02, 0.02])], pose)
        assert kpam.plan(problem(panda, bodies=[table(), free])).status == "solved"


def test_a_blocked_way_to_the_actuation_leaves_nothing_after_it(panda: kpam.Robot) -> None:
    settings = config(pre_actuation_motions=["move-left"] * 5)
    pose = np.eye(4)
    pose[:3, 3] = [0.5, 0.42, 0.3]
    screen = kpam.Body("screen", "object_body", [kpam.Shape.box([0.2, 0.005, 0.3])], pose)
    assert kpam.plan(problem(panda, config=settings)).status == "solved"
    plan = kpam.plan(problem(panda, config=settings, bodies=[table(), screen], options={"allow_partial": True}))
    assert plan.status == "collision"
    assert plan.trajectory is None
    assert plan.reached_fraction == 0.0
    reached = [frame["label"] for frame in plan.keyframes if frame["reached"]]
    assert reached[-1] == "actuation", "what comes after it cannot be reached either"
    assert plan.collisions[0]["toward"] in {f"pre_{k}" for k in range(5)}, plan.collisions


def test_contact_windows_replace_the_rules(panda: kpam.Robot) -> None:
    pose = np.eye(4)
    pose[:3, 3] = [0.5, 0.1, 0.2]
    lid = kpam.Body("lid", "object_body", [kpam.Shape.box([0.02, 0.02, 0.02])], pose)
    window = {
        "links": ["panda_hand", "panda_leftfinger", "panda_rightfinger"],
        "bodies": ["lid"],
        "from": "pre_0",
        "to": "end",
    }
    plan = kpam.plan(problem(panda, bodies=[table(), lid], options={"contacts": [window]}))
    assert plan.status == "solved", plan.reason


def test_contact_windows_count_pre_actuation_keyframes_from_the_actuation(panda: kpam.Robot) -> None:
    # The fingers are inside the block at pre_0, 4 cm above the actuation pose, and above it at pre_1.
    settings = config(pre_actuation_motions=[["translate_z", -0.04], ["translate_z", -0.06]])
    pose = np.eye(4)
    pose[:3, 3] = [0.5, 0.1, 0.23]
    block = kpam.Body("block", "object_body", [kpam.Shape.box([0.02, 0.05, 0.03])], pose)
    hand = ["panda_hand", "panda_leftfinger", "panda_rightfinger"]

    def status(start: str, end: str) -> str:
        window = {"links": hand, "bodies": ["block"], "from": start, "to": end, "depth": 0.1}
        question = problem(panda, config=settings, bodies=[table(), block], options={"contacts": [window]})
        return kpam.plan(question).status

    assert status("pre_1", "end") == "solved"
    assert status("pre_0", "end") == "collision"
    assert status("pre_1", "pre_0") == "collision"


def test_an_attached_body_is_part_of_the_hand(panda: kpam.Robot) -> None:
    grasp = np.eye(4)
    grasp[2, 3] = 0.25
    rod = kpam.Body("rod", "attached", [kpam.Shape.box([0.01, 0.01, 0.15])], grasp)
    plan = kpam.plan(problem(panda, bodies=[table(), rod]))
    assert plan.status == "start_in_collision"
    assert "table" in plan.reason
    plan = kpam.plan(problem(panda, bodies=[table(), rod], options={"start_depth": 1.0}))
    assert plan.status == "collision"
    assert "table" in plan.reason


def test_a_moving_start_is_taken_up(panda: kpam.Robot) -> None:
    velocity = np.zeros(9)
    velocity[0] = 0.5
    plan = kpam.plan(problem(panda, options={"start_velocity": velocity}))
    assert plan.status == "solved"
    assert plan.trajectory is not None
    np.testing.assert_allclose(plan.trajectory.sample(0.0)[1], velocity, atol=1e-12)


def test_the_same_bits_whatever_the_threads(panda: kpam.Robot) -> None:
    problems = [problem(panda, object_keypoints={"edge": [0.5, y, 0.2]}) for y in np.linspace(-0.3, 0.3, 8)]
    alone = [kpam.plan(each).to_dict() for each in problems]
    for threads in (1, 2, 3):
        together = [each.to_dict() for each in kpam.plan_batch(problems, threads=threads)]
        assert json.dumps(together) == json.dumps(alone)


def test_values_pickle(panda: kpam.Robot) -> None:
    scene = problem(panda)
    plan = kpam.plan(pickle.loads(pickle.dumps(scene)))
    again = pickle.loads(pickle.dumps(plan))
    assert again.to_dict() == plan.to_dict() == kpam.plan(scene).to_dict()
    assert again.trajectory is not None
    assert plan.trajectory is not None
    moved = pickle.loads(pickle.dumps(plan.trajectory))
    np.testing.assert_array_equal(moved.sample_every(0.05), plan.trajectory.sample_every(0.05))
    assert len(moved.sample_every(0.05)) == int(np.ceil(moved.duration / 0.05)) + 1


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"q_start": np.zeros(7)}, "q_start"),
        ({"q_start": np.full(9, np.nan)}, "q_start"),
        ({"q_start": np.full(9, 9.0)}, r"q_start\[0\]"),
        ({"T_base_object": np.zeros((4, 4))}, "T_base_object"),
        ({"object_keypoints": {"edge": [np.inf, 0, 0]}}, "object_keypoints"),
        ({"object_keypoints": {}}, "object_keypoints"),
        ({"tool_keypoints": {**TOOL, "tool_tail": TOOL["tool_head"]}}, "tool_keypoints"),
        ({"object_axis": "w"}, "object_axis"),
        ({"options": {"speed": 1}}, r"options\.speed"),
        ({"options": {"velocity_scale": "fast"}}, r"options\.velocity_scale"),
        ({"options": {"velocity_scale": float("nan")}}, r"options\.velocity_scale"),
        ({"options": {"contacts": [{"links": 3}]}}, r"options\.contacts\[0\]\.links"),
        ({"options": {"candidates": 0}}, r"options\.candidates"),
        ({"options": {"extra_seeds": 10**9}}, r"options\.extra_seeds"),
        ({"options": {"samples": 10**9}}, r"options\.samples"),
        ({"options": {"seed": 10**7}}, r"options\.seed"),
        ({"options": {"jerk_limits": [1e-9] * 9}}, r"options\.jerk_limits\[0\]"),
        ({"object_yaw": np.nan}, "object_yaw"),
        ({"options": {"velocity_scale": 0}}, "velocity_scale"),
        ({"options": {"velocity_limits": [1.0]}}, "velocity_limits"),
        ({"options": {"velocity_limits": [1e300] * 9}}, "velocity_limits"),
        ({"options": {"start_velocity": [1e300] * 9}}, "start_velocity"),
        ({"options": {"start_time": 1e300}}, "start_time"),
        ({"options": {"finger_width": 1e300}}, "finger_width"),
        ({"options": {"margin": 1e300}}, "margin"),
        ({"options": {"num_seeds": 10**9}}, r"options\.num_seeds"),
        ({"object_keypoints": {"edge": [1e300, 0, 0]}}, "object_keypoints"),
        ({"tool_keypoints": {**TOOL, "tool_head": [1e300, 0, 0]}}, "tool_keypoints"),
        ({"options": {"workspace": [[1, 1, 1], [0, 0, 0]]}}, "workspace"),
        ({"config": config(post_actuation_motions=[["follow_joint", 1]]), "joint": None}, "joint"),
    ],
)
def test_what_does_not_fit_is_named(panda: kpam.Robot, changes: dict[str, object], field: str) -> None:
    with pytest.raises(kpam.ProblemError, match=field):
        problem(panda, **changes)


def test_bad_shapes_are_named() -> None:
    with pytest.raises(kpam.ProblemError, match="half_extents"):
        kpam.Shape.box([1, 0, 1])
    with pytest.raises(kpam.ProblemError, match="points"):
        kpam.Shape.convex_hull(np.zeros((0, 3)))
    with pytest.raises(kpam.ProblemError, match=r"points\[1\]"):
        kpam.Shape.convex_hull([[0, 0, 0], [0, 0, np.nan]])
    with pytest.raises(kpam.ProblemError, match=r"triangles\[0\]"):
        kpam.Shape.mesh(np.zeros((3, 3)), [[0, 1, 7]])
    with pytest.raises(kpam.ProblemError, match=r"triangles\[0\].*1\.5"):
        kpam.Shape.mesh(np.eye(3), [[0, 1.5, 2]])
    with pytest.raises(kpam.ProblemError, match="axis"):
        kpam.Joint("revolute", [0, 0, 0], [0, 0, 0], 0, 0, 1)
    with pytest.raises(kpam.ProblemError, match="role"):
        kpam.Body("x", "wall", [], np.eye(4))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("urdf", "hand", "at"),
    [
        ("xarm7/xarm7.urdf", "link_eef", [0.4, 0.1, 0.3]),
        ("so100/so100.urdf", "Fixed_Jaw", [0.0, -0.2, 0.15]),
        ("fetch/fetch.urdf", "gripper_link", [0.6, 0.1, 0.7]),
    ],
)
def test_other_arms_reach(robots: Path, tmp_path: Path, urdf: str, hand: str, at: list[float]) -> None:
    file, srdf = robots / urdf, tmp_path / "arm.srdf"
    # The bellows of the Fetch are inside its base in 74 % of the configurations, also at the start.
    kpam.Robot.from_urdf(file, hand_link=hand).self_collisions(always=0.7, srdf=srdf)
    robot = kpam.Robot.from_urdf(file, hand_link=hand, srdf=srdf)
    settings = kpam.SolverConfig({"constraint_list": [point_to_point("tip", "goal", 1.0e-3)]})
    start = np.clip(np.zeros(len(robot.joint_names)), robot.lower, robot.upper)
    scene = kpam.KeypointProblem(
        robot,
        settings,
        start,
        tool_keypoints={"tip": [0, 0, 0]},
        object_keypoints={"goal": at},
        T_base_object=np.eye(4),
        # The SO100 and the Fetch have joints without a velocity limit in the URDF, and planning needs one.
        options={"workspace": None, "velocity_limits": np.where(np.isfinite(robot.velocity), robot.velocity, 1.0)},
    )
    plan = kpam.plan(scene)
    assert plan.status == "solved", plan.reason
    assert plan.trajectory is not None
    assert plan.start_overlap == 0.0
    end = robot.forward_kinematics(plan.trajectory.positions[-1])[:3, 3]
    assert np.abs(end - at).max() < 1.1e-3


def test_options_load_by_the_names_of_the_release_before(panda: kpam.Robot) -> None:
    with pytest.warns(FutureWarning, match=r"options\.starts is now called options\.num_seeds"):
        problem(panda, options={"starts": 3})
    with pytest.warns(FutureWarning), pytest.raises(kpam.ProblemError, match=r"options\.extra_seeds"):
        problem(panda, options={"harvest": 10**9})
    with pytest.raises(kpam.ProblemError, match=r"options\.descents: is the old name of num_refinements"):
        problem(panda, options={"descents": 3, "num_refinements": 3})


def test_keywords_work_by_the_names_of_the_release_before(panda: kpam.Robot) -> None:
    scene = problem(panda)
    first = kpam.plan(scene)
    calls = (
        (lambda **given: kpam.plan(scene, **given).status, {"former": first}, {"warm_start": first}),
        (lambda **given: len(kpam.ik(scene, **given)), {"most": 1}, {"max_solutions": 1}),
        (lambda **given: kpam.Scene(panda).distance(Q_START, **given), {"most": 0.5}, {"max_distance": 0.5}),
    )
    for call, before, today in calls:
        with pytest.warns(FutureWarning, match=f"{next(iter(before))} is now called {next(iter(today))}"):
            assert call(**before) == call(**today)  # type: ignore[no-untyped-call]
        with pytest.raises(TypeError, match="which is given too"):
            call(**before, **today)  # type: ignore[no-untyped-call]
        with pytest.raises(TypeError, match="unexpected keyword argument 'other'"):
            call(other=1)  # type: ignore[no-untyped-call]

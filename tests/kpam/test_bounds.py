"""No input panics, hangs or fills the memory: options have ranges, and long calls end at Ctrl-C."""

from __future__ import annotations

import os
import signal
import threading
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from constraints import point_to_point

import gensim2_kpam as kpam

from .kpam_scenes import Q_START, config, problem

POINT = point_to_point("tip", "goal", 0.001)
TO_A_POINT = {"constraint_list": [POINT]}
POINTS = {"tool_keypoints": {"tip": [0.0, 0.0, 0.1]}, "object_keypoints": {"goal": [0.5, 0.0, 0.4]}}


def still_robot(tmp_path: Path) -> kpam.Robot:
    file = tmp_path / "still.urdf"
    file.write_text(
        "<robot name='still'><link name='b'/><link name='h'/><joint name='j' type='fixed'><origin xyz='0 0 1'/>"
        "<parent link='b'/><child link='h'/></joint></robot>"
    )
    return kpam.Robot.from_urdf(file, hand_link="h")


def test_a_robot_without_moving_joints(tmp_path: Path) -> None:
    robot = still_robot(tmp_path)
    assert robot.jacobian([]).shape == (6, 0)
    assert robot.jacobian(np.zeros((3, 0))).shape == (3, 6, 0)
    assert robot.forward_kinematics([])[2, 3] == 1.0
    assert robot.forward_kinematics(np.zeros((3, 0)))[:, 2, 3].tolist() == [1.0, 1.0, 1.0]
    with pytest.raises(kpam.ProblemError, match="robot"):
        problem(robot, q_start=[])


def test_goals_of_a_robot_without_moving_joints_are_refused(tmp_path: Path) -> None:
    scene = kpam.Scene(still_robot(tmp_path))
    for goal in ([], np.zeros((3, 0)), np.eye(4)):
        with pytest.raises(kpam.ProblemError, match="robot: plans 0 independent joints"):
            scene.plan_to([], goal)


ODD_NUMBERS: dict[str, Callable[[Any], Any]] = {
    "complex": lambda q: q + 1j,
    "text": lambda q: [str(value) for value in q],
    "text among objects": lambda q: np.array([*q[:-1], "0.04"], dtype=object),
    "times": lambda q: q.astype("m8[s]"),
    "dates": lambda q: q.astype("i8").astype("M8[s]"),
    "records": lambda q: np.zeros(len(q), [("a", "f8")]),
    "nothing": lambda q: [None] * len(q),
    "masked": lambda q: np.ma.masked_array(q, mask=[True, *[False] * 8]),
}


@pytest.mark.parametrize("kind", ODD_NUMBERS)
def test_only_real_numbers_are_read_as_numbers(panda: kpam.Robot, kind: str) -> None:
    with pytest.raises(kpam.ProblemError, match="q: must be an array of numbers"):
        panda.forward_kinematics(ODD_NUMBERS[kind](Q_START))


def test_layouts_of_numbers_make_no_difference(panda: kpam.Robot) -> None:
    expected = panda.forward_kinematics(Q_START)
    odd = np.frombuffer(b"\0" + Q_START.tobytes(), dtype=np.uint8)[1:].view(np.float64)
    for layout in (odd, Q_START[::-1].copy()[::-1], np.repeat(Q_START, 2)[::2], Q_START.astype(">f8"), list(Q_START)):
        np.testing.assert_array_equal(panda.forward_kinematics(layout), expected)
    trajectory = kpam.Scene(panda).plan_to(Q_START, Q_START + np.eye(9)[0] * 0.1).trajectory
    assert trajectory is not None
    unaligned = np.zeros(8 * 9 + 1, dtype=np.uint8)[1:].view(np.float64)
    with pytest.raises(kpam.ProblemError, match="position: must be contiguous and aligned"):
        trajectory.sample_into(0.0, unaligned, np.zeros(9), np.zeros(9))


def test_an_array_larger_than_the_memory_is_refused(panda: kpam.Robot) -> None:
    with pytest.raises(kpam.ProblemError, match="q: has 9895604649984 numbers, too many for the available memory"):
        panda.forward_kinematics(np.broadcast_to(Q_START, (2**40, 9)))


@pytest.mark.parametrize("gravity", [(0.0, 0.0, np.nan), (0.0, np.inf, 0.0)])
def test_torques_are_finite(panda: kpam.Robot, gravity: tuple[float, float, float]) -> None:
    with pytest.raises(kpam.ProblemError, match="gravity"):
        panda.inverse_dynamics(Q_START, Q_START, Q_START, gravity=gravity)
    with pytest.raises(kpam.ProblemError, match="velocity, acceleration: are too large"):
        panda.inverse_dynamics(Q_START, np.full(9, 1e308), Q_START)


@pytest.mark.parametrize("name", ["x" * 1_000_000, "x\n" * 500_000, "\u202e\x1b[31m", "a\0b"])
def test_errors_that_quote_a_name_are_one_short_line(panda: kpam.Robot, name: str) -> None:
    for call in (
        lambda: panda.forward_kinematics(Q_START, name),
        lambda: kpam.SolverConfig({name: 1}),
        lambda: kpam.Scene(panda).with_pose(name, np.eye(4)),
        lambda: problem(panda, options={name: 1}),
    ):
        with pytest.raises(kpam.KpamError) as caught:
            call()
        for text in (str(caught.value), caught.value.message):
            assert text is not None
            assert text.isprintable()
            assert len(text) < 2000


@pytest.mark.parametrize("value", ["\ud800", 10**400])
def test_values_of_a_config_that_are_no_values_are_named(value: object) -> None:
    with pytest.raises(kpam.ConfigError, match="let_go"):
        kpam.SolverConfig({"constraint_list": [], "let_go": value})


def test_a_thin_workspace(panda: kpam.Robot) -> None:
    tip = np.array([0.5, 0.1, 0.2 + 0.105])
    for half in (0.9e-3, 1e-4, 1e-17, 0.0):
        plan = kpam.plan(problem(panda, options={"workspace": [tip - half, tip + half]}))
        assert plan.status in ("solved", "actuation_infeasible")


@pytest.mark.parametrize(("lower", "upper"), [("4", "inf"), ("-inf", "-4"), ("-inf", "3"), ("-inf", "inf")])
def test_limits_that_are_open_on_one_side(tmp_path: Path, lower: str, upper: str) -> None:
    links = "".join(f"<link name='l{i}'/>" for i in range(4))
    limits = [(lower, upper), ("-2", "2"), ("-2", "2")]
    joints = "".join(
        f"<joint name='j{i}' type='revolute'><parent link='l{i}'/><child link='l{i + 1}'/><origin xyz='0.3 0 0.1'/>"
        f"<axis xyz='0 {i % 2} {1 - i % 2}'/><limit lower='{low}' upper='{high}' effort='1' velocity='2'/></joint>"
        for i, (low, high) in enumerate(limits)
    )
    file = tmp_path / "arm.urdf"
    file.write_text(f"<robot name='arm'>{links}{joints}</robot>")
    robot = kpam.Robot.from_urdf(file, hand_link="l3")
    start = [5.0 if lower == "4" else -5.0 if upper == "-4" else 0.0, 0.2, 0.3]
    away = np.array([start[0] + 0.4, -0.3, 0.8])
    goal = robot.forward_kinematics(away)[:3, 3]
    plan = kpam.plan(
        problem(
            robot,
            config=TO_A_POINT,
            q_start=start,
            tool_keypoints={"tip": [0, 0, 0]},
            object_keypoints={"goal": goal},
            bodies=[],
            options={"workspace": None},
        )
    )
    assert plan.status == "solved", plan.reason
    assert plan.q_plan is not None
    assert (plan.q_plan >= robot.lower).all()
    assert (plan.q_plan <= robot.upper).all()


@pytest.mark.parametrize("option", ["velocity_scale", "acceleration_scale"])
@pytest.mark.parametrize("value", [1e-30, 1e-12, 1e-6, 0.9e-3, 1.1, -1.0])
def test_scales_have_a_range(panda: kpam.Robot, option: str, value: float) -> None:
    with pytest.raises(kpam.ProblemError, match=rf"options\.{option}.*0\.001") as caught:
        problem(panda, options={option: value})
    assert caught.value.field == f"options.{option}"


def test_the_slowest_motion_has_a_bounded_number_of_waypoints(panda: kpam.Robot) -> None:
    slow = {"velocity_limits": [1e-3] * 9, "velocity_scale": 1e-3}
    plan = kpam.plan(problem(panda, options=slow))
    assert plan.trajectory is not None
    assert plan.trajectory.duration > 1e5
    assert len(plan.trajectory.times) < 101_000
    with pytest.raises(kpam.ProblemError, match="dt"):
        plan.trajectory.sample_every(0.01)
    with pytest.raises(kpam.ProblemError, match=r"options\.velocity_limits\[3\]"):
        problem(panda, options={"velocity_limits": [1.0, 1.0, 1.0, 1e-5, *[1.0] * 5]})


def test_a_clock_far_away_has_a_bounded_number_of_waypoints(panda: kpam.Robot) -> None:
    plan = kpam.plan(problem(panda, config=config(actuation_time=9e5)))
    assert plan.trajectory is not None
    assert len(plan.trajectory.times) < 101_000


def test_a_joint_that_stands_still_is_named(tmp_path: Path) -> None:
    file = tmp_path / "slow.urdf"
    file.write_text(
        "<robot name='slow'><link name='b'/><link name='h'/><joint name='snail' type='revolute'><parent link='b'/>"
        "<child link='h'/><axis xyz='0 0 1'/><limit lower='-1' upper='1' effort='1' velocity='1e-30'/></joint></robot>"
    )
    robot = kpam.Robot.from_urdf(file, hand_link="h")
    with pytest.raises(kpam.ProblemError, match=r"options\.velocity_limits.*snail"):
        problem(robot, q_start=[0.0])


def test_clearance_steps_have_a_lower_bound(panda: kpam.Robot) -> None:
    scene = problem(panda)
    plan = kpam.plan(scene)
    for step in (1e-9, 0.0, -1.0, float("nan")):
        with pytest.raises(kpam.ProblemError, match=r"step.*at least"):
            kpam.min_clearance(scene, plan, step)
    assert plan.trajectory is not None
    assert kpam.min_clearance(scene, plan, plan.trajectory.duration / 500) is not None


@pytest.mark.parametrize("threads", [0, 257, 1_000_000])
def test_threads_have_a_range(panda: kpam.Robot, threads: int) -> None:
    with pytest.raises(kpam.ProblemError, match=r"threads.*1 to 256"):
        kpam.plan_batch([problem(panda)], threads=threads)


def interrupted(call: Any) -> float:
    """Return the seconds from Ctrl-C to the end of a long call."""
    sent: list[float] = []

    def press() -> None:
        time.sleep(0.3)
        sent.append(time.monotonic())
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=press)
    thread.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            call()
        return time.monotonic() - sent[0]
    finally:
        thread.join()


def test_ctrl_c_ends_a_batch(panda: kpam.Robot) -> None:
    scenes = [problem(panda)] * 100_000
    assert interrupted(lambda: kpam.plan_batch(scenes, threads=2)) < 2.0


def test_a_forked_process_plans(panda: kpam.Robot) -> None:
    """Threads do not survive a fork, so the new process must start its own."""
    scene = problem(panda)
    expected = kpam.plan(scene).status
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if child == 0:
        os._exit(0 if kpam.plan(scene).status == expected else 1)
    end = time.monotonic() + 30.0
    ended, code = os.waitpid(child, os.WNOHANG)
    while not ended and time.monotonic() < end:
        time.sleep(0.01)
        ended, code = os.waitpid(child, os.WNOHANG)
    if not ended:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    assert ended == child
    assert os.waitstatus_to_exitcode(code) == 0


def test_ctrl_c_ends_measuring(panda: kpam.Robot) -> None:
    scene = problem(panda)
    plan = kpam.plan(scene)
    assert plan.trajectory is not None
    step = plan.trajectory.duration / 99_000
    assert interrupted(lambda: [kpam.min_clearance(scene, plan, step) for _ in range(100)]) < 2.0
    many = np.repeat(Q_START[None], 1_000_000, axis=0)
    assert interrupted(lambda: [scene.scene.in_collision(many) for _ in range(100)]) < 2.0


def test_ctrl_c_ends_making_ready_what_has_millions_of_triangles(panda: kpam.Robot) -> None:
    """The trees of large meshes are built in an uninterruptible call of seconds, so its thread is left behind."""
    side = 1001
    x, y = np.meshgrid(np.linspace(0.0, 1.0, side), np.linspace(0.0, 1.0, side), indexing="ij")
    points = np.stack([x, y, 0.05 * np.sin(20 * x) - 0.6], axis=-1).reshape(-1, 3)
    corner = np.arange(side * side).reshape(side, side)[:-1, :-1].ravel()
    halves = [[corner, corner + 1, corner + side], [corner + 1, corner + side + 1, corner + side]]
    mesh = kpam.Shape.mesh(points, np.concatenate([np.stack(half, axis=1) for half in halves]))
    body = kpam.Body("ground", "rigid", [mesh], np.eye(4))
    calls: list[Callable[[], object]] = [
        lambda: kpam.Scene(panda, [body]).in_collision(Q_START),
        lambda: kpam.plan(problem(panda, bodies=[body], config=TO_A_POINT, **POINTS)),
    ]
    for call in calls:
        threads = len(list(Path("/proc/self/task").iterdir()))
        assert interrupted(call) < 1.0
        while len(list(Path("/proc/self/task").iterdir())) > threads:  # wait for the end of the thread
            time.sleep(0.05)


def test_errors_name_file_and_field(panda: kpam.Robot, tmp_path: Path) -> None:
    with pytest.raises(kpam.UrdfError) as urdf:
        kpam.Robot.from_urdf(tmp_path / "none.urdf", hand_link="hand")
    assert urdf.value.file == str(tmp_path / "none.urdf")
    assert urdf.value.field == "file"
    with pytest.raises(kpam.ConfigError) as settings:
        kpam.SolverConfig({"constraint_list": [], "speed": 2})
    assert (settings.value.file, settings.value.field) == (None, "speed")
    with pytest.raises(kpam.ProblemError) as shape:
        kpam.Shape.sphere(-1.0)
    assert shape.value.field == "radius"
    assert kpam.KpamError("x").field is None


def test_limits_of_which_nothing_is_said_are_plain_and_told(panda: kpam.Robot, robots: Path) -> None:
    """The names of its joints do not make an arm a Franka."""

    def planned(**options: Any) -> kpam.Plan:
        changes = {"acceleration_scale": 1.0, "velocity_limits": [100.0] * 9, "limits": None, **options}
        return kpam.plan(
            problem(
                panda,
                config=TO_A_POINT,
                tool_keypoints={"tip": [0, 0, 0]},
                options=changes,
                object_keypoints={"goal": [0.6, 0.0, 0.3]},
                bodies=[],
            )
        )

    def duration(plan: kpam.Plan) -> float:
        assert plan.trajectory is not None, plan.reason
        return plan.trajectory.duration

    assumed = planned()
    assert assumed.assumed_limits == ["acceleration", "jerk"]
    for name, value in (("acceleration", r"10 rad/s^2"), ("jerk", r"5,000 rad/s^3")):
        told = next(warning for warning in assumed.warnings if f"{name} are assumed" in warning)
        assert value in told
        assert "panda_joint1" in told
    assert duration(assumed) == duration(planned(limits="plain")) != duration(planned(limits="panda"))
    assert planned(limits="plain").assumed_limits == planned(limits="panda").assumed_limits == []
    assert planned(acceleration_limits=[5.0] * 9).assumed_limits == ["jerk"]
    so100 = kpam.Robot.from_urdf(robots / "so100" / "so100.urdf", hand_link="Fixed_Jaw")
    with pytest.raises(kpam.ProblemError, match=r"options\.limits"):
        problem(so100, q_start=np.clip(np.zeros(6), so100.lower, so100.upper), options={"limits": "panda"})

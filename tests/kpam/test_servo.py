"""Servoing: limits hold in every step, obstacles are avoided, and wrong arguments are refused."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gensim2_kpam as kpam
from gensim2.core.seeding import rng

Array = np.ndarray
DT = 0.001
VELOCITY, ACCELERATION, JERK = 2.0, 8.0, 500.0
READY = np.array([0.0, -0.6, 0.0, -2.2, 0.0, 1.7, 0.78])


@pytest.fixture(scope="module")
def arm(panda: kpam.Robot) -> kpam.Robot:
    return panda


def full(robot: kpam.Robot, q: Array) -> Array:
    """Add the fingers to the values of the seven joints."""
    return np.concatenate([q, np.full(len(robot.joint_names) - 7, 0.02)])


def servo_of(scene: kpam.Scene, q: Array, **options: Any) -> kpam.Servo:
    n = len(scene.robot.joint_names)
    limits = {
        "velocity_limits": np.full(n, VELOCITY),
        "acceleration_limits": np.full(n, ACCELERATION),
        "jerk_limits": np.full(n, JERK),
    }
    return kpam.Servo(scene, q, **{**limits, **options})


def assert_limits(robot: kpam.Robot, path: Array, dt: float = DT, jerk: float = JERK) -> None:
    """Check limits by finite differences of positions (M, n)."""
    lower, upper = np.asarray(robot.lower), np.asarray(robot.upper)
    assert (path >= lower - 1e-6).all()
    assert (path <= upper + 1e-6).all()
    assert np.abs(np.diff(path, axis=0)).max() / dt <= VELOCITY * (1 + 1e-6)
    assert np.abs(np.diff(path, 2, axis=0)).max() / dt**2 <= ACCELERATION * (1 + 1e-6)
    assert np.abs(np.diff(path, 3, axis=0)).max() / dt**3 <= jerk * (1 + 1e-6) + 1e-4


def follow(servo: kpam.Servo, steps: int, *target: Any, **twist: Any) -> list[kpam.ServoStep]:
    return [servo.step(*target, **twist) for _ in range(steps)]


def positions(start: Array, steps: list[kpam.ServoStep]) -> Array:
    return np.array([start] * 3 + [step.position for step in steps])


def test_a_pose_is_reached_and_states_are_consistent(arm: kpam.Robot) -> None:
    start = full(arm, READY)
    servo = servo_of(kpam.Scene(arm), start)
    goal = arm.forward_kinematics(start).copy()
    goal[:3, 3] += [0.1, 0.15, 0.1]
    steps = follow(servo, 2500, goal)
    path = positions(start, steps)
    assert_limits(arm, path)
    np.testing.assert_allclose(arm.forward_kinematics(path[-1]), goal, atol=2e-4)
    assert np.abs(steps[-1].velocity).max() < 1e-2
    for before, after in itertools.pairwise(steps):
        mean = 0.5 * (before.velocity + after.velocity)
        np.testing.assert_allclose((after.position - before.position) / DT, mean, atol=1e-4)


def test_a_moving_pose_is_followed_closely_with_its_velocity(arm: kpam.Robot) -> None:
    start = full(arm, READY)
    servo, begin = servo_of(kpam.Scene(arm), start), arm.forward_kinematics(start)
    errors = []
    for k in range(4000):
        phase, pose, twist = 1.5 * DT * k, begin.copy(), np.zeros(6)
        pose[:3, 3] += [0.0, 0.15 * np.sin(phase), 0.05 * (1.0 - np.cos(phase))]
        twist[:3] = [0.0, 0.15 * 1.5 * np.cos(phase), 0.05 * 1.5 * np.sin(phase)]
        step = servo.step(pose, twist=twist)
        if k > 1000:
            errors.append(np.linalg.norm(arm.forward_kinematics(step.position)[:3, 3] - pose[:3, 3]))
    assert max(errors) < 2e-3


@pytest.mark.parametrize("dt", [0.0005, 0.001, 0.004, 0.02])
def test_limits_hold_at_extreme_targets(arm: kpam.Robot, dt: float) -> None:
    start, draw = full(arm, READY), rng(0, "extreme targets")
    servo, path = servo_of(kpam.Scene(arm), start, dt=dt), [start] * 3
    for kind in ("joints", "pose", "twist", "none") * 4:
        joints = np.concatenate([draw.choice([-50.0, 50.0], 7), start[7:]])
        pose = arm.forward_kinematics(start).copy()
        pose[:3, 3] = draw.normal(0.0, 5.0, 3)
        arguments: dict[str, Any] = {
            "joints": {"target": joints},
            "pose": {"target": pose},
            "twist": {"twist": draw.normal(0.0, 50.0, 6)},
            "none": {},
        }[kind]
        path += [servo.step(**arguments).position for _ in range(int(draw.uniform(0.05, 1.0) / dt))]
    assert_limits(arm, np.array(path), dt)


def obstacles(arm: kpam.Robot, at: Array) -> list[kpam.Body]:
    """Return a box, a capsule and a cloud around a point."""
    places = at + np.array([[0.0, 0.25, 0.0], [0.0, -0.28, 0.0], [0.12, 0.0, 0.22]])
    cloud = rng(1, "servo cloud").uniform(-0.06, 0.06, (500, 3))
    shapes = [kpam.Shape.box([0.08, 0.08, 0.08]), kpam.Shape.capsule(0.05, 0.2), kpam.Shape.point_cloud(cloud, 0.01)]
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, 3] = places
    names = ("box", "capsule", "cloud")
    return [kpam.Body(n, "rigid", [s], p) for n, s, p in zip(names, shapes, poses, strict=True)]


@pytest.mark.parametrize("margin", [0.0, 0.005, 0.02])
def test_targets_inside_obstacles_are_not_reached(arm: kpam.Robot, margin: float) -> None:
    start = full(arm, READY)
    bodies = obstacles(arm, arm.forward_kinematics(start)[:3, 3])
    scene = kpam.Scene(arm, bodies)
    assert scene.distance(start) > margin
    servo, path, said = servo_of(scene, start, margin=margin), [start] * 3, set()
    for body in bodies * 2:
        goal = arm.forward_kinematics(start).copy()
        goal[:3, 3] = body.pose[:3, 3]
        steps = follow(servo, 1500, goal)
        path += [step.position for step in steps]
        said |= {text for step in steps for text in step.limited_by}
        # It comes near without a stop far away from the obstacle.
        assert scene.distance(path[-1]) < margin + 0.02
    rows = np.array(path)
    assert_limits(arm, rows)
    assert not scene.in_collision(rows).any()
    assert scene.distance(rows[::7]).min() >= margin - 1e-6
    assert any("box" in text for text in said)
    assert any("cloud" in text for text in said)


def test_links_do_not_touch_each_other(arm: kpam.Robot) -> None:
    start = full(arm, READY)
    scene = kpam.Scene(arm)
    servo, path = servo_of(scene, start), [start] * 3
    goal = arm.forward_kinematics(start).copy()
    goal[:3, 3] = [0.0, 0.0, 0.3]
    path += [step.position for step in follow(servo, 4000, goal)]
    rows = np.array(path)
    assert_limits(arm, rows)
    assert not scene.in_collision(rows).any()


def test_a_singular_start_and_a_pose_out_of_reach_do_no_harm(arm: kpam.Robot) -> None:
    start = full(arm, np.array([0.0, 0.3, 0.0, -0.1, 0.0, 1.6, 0.78]))
    servo = servo_of(kpam.Scene(arm), start)
    goal = arm.forward_kinematics(start).copy()
    goal[:3, 3] = [0.9, 0.9, 0.9]
    steps = follow(servo, 6000, goal)
    path = positions(start, steps)
    assert_limits(arm, path)
    # It points toward the target, and rests.
    hand = arm.forward_kinematics(path[-1])[:3, 3]
    assert np.linalg.norm(goal[:3, 3] - hand) < np.linalg.norm(goal[:3, 3] - arm.forward_kinematics(start)[:3, 3]) - 0.3
    assert np.abs(path[-500:] - path[-1]).max() < 0.02


def test_a_start_with_velocity_near_a_limit_stops_in_time(arm: kpam.Robot) -> None:
    start, velocity = full(arm, READY), np.zeros(len(arm.joint_names))
    velocity[0] = 1.5
    # It needs 1.5^2 / 16 = 0.141 rad to stop, and some more because of the jerk limit.
    start[0] = arm.upper[0] - 0.17
    servo = servo_of(kpam.Scene(arm), start)
    servo.reset(start, velocity)
    steps = follow(servo, 1000, twist=[5.0, 0.0, 0.0, 0.0, 0.0, 5.0])
    before = np.array([start - k * DT * velocity for k in (2, 1, 0)])
    assert_limits(arm, np.concatenate([before, [step.position for step in steps]]))
    start[0] = arm.upper[0] - 0.1
    with pytest.raises(kpam.ProblemError, match="velocity: joint panda_joint1 cannot be stopped in time"):
        servo.reset(start, velocity)
    # The former state remains.
    np.testing.assert_allclose(servo.step().position, steps[-1].position, atol=3e-3)


def test_a_moving_start_in_front_of_a_wall_is_refused(arm: kpam.Robot) -> None:
    start, velocity = full(arm, READY), np.zeros(len(arm.joint_names))
    pose = arm.forward_kinematics(start).copy()
    pose[:3, 3] += [0.0, 0.2, 0.0]
    scene = kpam.Scene(arm, [kpam.Body("wall", "rigid", [kpam.Shape.box([0.3, 0.05, 0.3])], pose)])
    servo = servo_of(scene, start)
    velocity[0] = 1.9
    with pytest.raises(kpam.ProblemError, match=r"no stop from this state is proven to keep 5.0 mm .*wall"):
        servo.reset(start, velocity)
    servo.reset(start, -velocity)


def test_the_posture_moves_without_the_hand(arm: kpam.Robot) -> None:
    start = full(arm, READY)
    posture = start.copy()
    posture[0] += 0.5
    servo, pose = servo_of(kpam.Scene(arm), start, posture=posture), arm.forward_kinematics(start)
    last = follow(servo, 4000, pose)[-1].position
    np.testing.assert_allclose(arm.forward_kinematics(last), pose, atol=5e-4)
    assert np.abs(last - start)[:7].max() > 0.1
    assert np.linalg.norm(last - posture) < np.linalg.norm(start - posture) - 0.05


def test_without_a_target_the_arm_comes_to_rest(arm: kpam.Robot) -> None:
    start = full(arm, READY)
    servo = servo_of(kpam.Scene(arm), start)
    moving = follow(servo, 300, twist=[0.0, 0.3, 0.0, 0.0, 0.0, 0.0])[-1]
    assert np.abs(moving.velocity).max() > 0.1
    assert str(moving.status) in ("tracking", "limited")
    assert np.abs(follow(servo, 500)[-1].velocity).max() < 1e-9


def test_fr3_limits_depend_on_the_position(arm: kpam.Robot) -> None:
    start = full(arm, READY)
    servo = kpam.Servo(kpam.Scene(arm), start, limits="fr3")
    goal = start.copy()
    goal[0] = 2.7
    steps = follow(servo, 4000, goal)
    q = np.array([step.position[0] for step in steps])
    v = np.array([step.velocity[0] for step in steps])
    most = -0.3 + np.sqrt(np.maximum(12.0 * (2.7501 - q), 0.0))
    assert (v <= np.maximum(most, 0.0) + 1e-5).all()
    assert v.max() > 1.5


def test_mimic_joints_follow_and_keep_their_limits(tmp_path: Path) -> None:
    joint = '<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/><origin xyz="0 0 0.3"/>{}{}</joint>'
    limit = '<axis xyz="0 1 0"/><limit lower="-{0}" upper="{0}" velocity="{1}" effort="1"/>'
    links = "".join(f'<link name="l{i}"/>' for i in range(4))
    joints = (
        joint.format("a", "l0", "l1", limit.format(1.0, 2.0), "")
        + joint.format("b", "l1", "l2", limit.format(1.0, 1.0), '<mimic joint="a" multiplier="-2" offset="0.1"/>')
        + joint.format("c", "l2", "l3", limit.format(2.0, 2.0), "")
    )
    file = tmp_path / "m.urdf"
    file.write_text(f'<robot name="m">{links}{joints}</robot>')
    robot = kpam.Robot.from_urdf(file, hand_link="l3")
    start = robot.apply_mimic(np.zeros(3))
    servo = kpam.Servo(kpam.Scene(robot), start, acceleration_limits=[8.0] * 3, jerk_limits=[500.0] * 3)
    goal = robot.apply_mimic(np.array([5.0, 0.0, -5.0]))
    path = positions(start, follow(servo, 2000, goal))
    np.testing.assert_allclose(path[:, 1], -2.0 * path[:, 0] + 0.1, atol=1e-12)
    assert path[:, 0].max() <= 0.55 + 1e-6
    assert np.abs(path[:, 1]).max() <= 1.0 + 1e-6
    assert path[:, 2].min() >= -2.0 - 1e-6
    assert path[-1, 0] == pytest.approx(0.55, abs=1e-3)
    assert np.abs(np.diff(path[:, 1])).max() / DT <= 1.0 + 1e-6
    assert np.abs(np.diff(path[:, 1], 2)).max() / DT**2 <= 8.0 + 1e-5


def test_steps_are_reproducible(arm: kpam.Robot) -> None:
    start = full(arm, READY)
    scene = kpam.Scene(arm, obstacles(arm, arm.forward_kinematics(start)[:3, 3]))
    goal = arm.forward_kinematics(start).copy()
    goal[:3, 3] += [0.0, 0.25, 0.0]
    paths = [[step.position.tobytes() for step in follow(servo_of(scene, start), 500, goal)] for _ in range(2)]
    assert paths[0] == paths[1]


def test_wrong_arguments_are_refused(arm: kpam.Robot) -> None:
    start = full(arm, READY)
    scene = kpam.Scene(arm)
    refused: list[tuple[dict[str, Any], str]] = [
        ({"margin": 0.5}, "margin"),
        ({"margin": float("nan")}, "margin"),
        ({"dt": 0.0}, "dt"),
        ({"dt": float("inf")}, "dt"),
        ({"link": "nose"}, "link"),
        ({"link": "panda_link0"}, "link"),
        ({"posture": start[:3]}, "posture"),
        ({"posture": start + 9.0}, "posture"),
        ({"limits": "best"}, "limits"),
        ({"velocity_limits": [1.0]}, "velocity_limits"),
        ({"acceleration_limits": np.zeros(len(start))}, "acceleration_limits"),
        ({"velocity_scale": 2.0}, "velocity_scale"),
    ]
    for options, field in refused:
        with pytest.raises(kpam.ProblemError, match=field):
            kpam.Servo(scene, start, **options)
    for q in (start[:3], start * np.nan, start + 9.0):
        with pytest.raises(kpam.ProblemError, match=r"^q"):
            kpam.Servo(scene, q)
    pose = arm.forward_kinematics(start)
    inside = kpam.Scene(arm, [kpam.Body("box", "rigid", [kpam.Shape.box([0.1, 0.1, 0.1])], pose)])
    with pytest.raises(kpam.ProblemError, match=r"overlap by .* start from a configuration without collisions"):
        kpam.Servo(inside, start)
    servo, moved = kpam.Servo(scene, start), start.copy()
    moved[-1] += 0.01
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"target": np.zeros(3)}, "target"),
        ({"target": np.zeros((4, 4))}, "target"),
        ({"target": start * np.nan}, "target"),
        ({"target": moved}, "target"),
        ({"target": start, "twist": np.zeros(6)}, "twist"),
        ({"twist": np.zeros(3)}, "twist"),
        ({"twist": np.full(6, np.inf)}, "twist"),
        ({"target": "home"}, "target"),
    ]
    for arguments, field in wrong:
        with pytest.raises(kpam.ProblemError, match=field):
            servo.step(**arguments)
    np.testing.assert_array_equal(servo.step().position, start)
    assert "acceleration" in " ".join(servo.warnings) or servo.warnings == []


def test_a_benchmark_minute_keeps_all_limits(monkeypatch: pytest.MonkeyPatch, robots: Path, tmp_path: Path) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    import servo

    row = servo.run("xarm7", 0.1, 0, robots, tmp_path)
    assert row.steps == 6000
    assert row.exceeded == 0
    assert row.judged == 120
    assert row.obstacle_mm > 4.6
    assert row.self_mm > 0.0
    assert 0.5 < max(row.used[1:]) <= 1.0 + 1e-6


def test_the_default_posture_is_that_of_the_last_reset(arm: kpam.Robot) -> None:
    start = full(arm, READY)
    later = start.copy()
    later[:7] += [0.3, 0.1, -0.3, 0.1, 0.2, 0.1, -0.3]
    servo = servo_of(kpam.Scene(arm), start)
    servo.reset(later)
    last = follow(servo, 2000, arm.forward_kinematics(later))[-1].position
    np.testing.assert_allclose(last, later, atol=1e-6)

"""Motions along hand poses: all samples are within tolerance, limits and margin; refusals name the cause."""

from __future__ import annotations

import itertools
import re
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import gensim2_kpam as kpam

from .kpam_scenes import Q_START

Array = np.ndarray
VELOCITY, ACCELERATION, JERK = np.full(9, 1.5), np.full(9, 6.0), np.full(9, 300.0)
LIMITS: dict[str, Any] = {
    "velocity_limits": VELOCITY,
    "acceleration_limits": ACCELERATION,
    "jerk_limits": JERK,
}


def moved(pose: Array, shift: list[float], turn: list[float] | None = None) -> Array:
    """Return a pose moved in the base frame and turned by a rotation vector in the hand frame (rad)."""
    out = pose.copy()
    out[:3, 3] += shift
    out[:3, :3] = out[:3, :3] @ Rotation.from_rotvec(turn or [0, 0, 0]).as_matrix()
    return out


def lines(first: Array, poses: list[Array]) -> tuple[Array, Rotation, Array]:
    """Return dense positions (M, 3) and rotations of the lines, and the number of the line of each."""
    positions, rotations, number = [], [], []
    share = np.linspace(0, 1, 2001)
    for k, (a, b) in enumerate(zip([first, *poses[:-1]], poses, strict=True)):
        positions.append(a[:3, 3] + share[:, None] * (b[:3, 3] - a[:3, 3]))
        rotations.append(Slerp([0, 1], Rotation.from_matrix([a[:3, :3], b[:3, :3]]))(share).as_matrix())
        number.append(np.full(len(share), k))
    return np.concatenate(positions), Rotation.from_matrix(np.concatenate(rotations)), np.concatenate(number)


def assert_follows(
    robot: kpam.Robot, motion: kpam.Trajectory, poses: list[Array], tolerance: tuple[float, float], free: Any = None
) -> None:
    """Check samples of a motion against the lines, computed independently, in order."""
    first = np.asarray(robot.forward_kinematics(motion.positions[0]))
    positions, rotations, number = lines(first, poses)
    samples = np.asarray(motion.sample_every(0.004))
    hands = np.asarray(robot.forward_kinematics(samples))
    at = 0
    for hand in hands:
        way = np.linalg.norm(positions[at:] - hand[:3, 3], axis=1)
        relative = rotations[at:].inv() * Rotation.from_matrix(hand[:3, :3])
        if free is None:
            turn = relative.magnitude()
        else:
            turn = np.arccos(np.clip(relative.apply(free) @ np.asarray(free), -1, 1))
        inside = (way <= tolerance[0] + 1e-5) & (turn <= tolerance[1] + 1e-3)
        assert inside.any(), f"line {number[at]}: {way.min()} m"
        at += int(np.argmax(inside))  # the hand never goes back
    end = hands[-1]
    np.testing.assert_allclose(end[:3, 3], poses[-1][:3, 3], atol=1e-5)
    # Limits, by finite differences.
    dt = 0.001
    path = np.asarray(motion.sample_every(dt))[:-1]
    assert (path >= robot.lower - 1e-9).all()
    assert (path <= robot.upper + 1e-9).all()
    assert (np.abs(np.diff(path, axis=0)) / dt <= VELOCITY * (1 + 1e-6)).all()
    assert (np.abs(np.diff(path, 2, axis=0)) / dt**2 <= ACCELERATION * (1 + 1e-5)).all()
    assert (np.abs(np.diff(path, 3, axis=0)) / dt**3 <= JERK * (1 + 1e-4) + 1e-3).all()


def test_the_hand_stays_on_the_lines(panda: kpam.Robot) -> None:
    scene, first = kpam.Scene(panda), np.asarray(panda.forward_kinematics(Q_START))
    poses = [
        moved(first, [0.0, 0.2, 0.0]),
        moved(first, [0.0, 0.2, -0.15], [0.0, 0.3, 0.4]),
        moved(first, [0.1, -0.2, -0.15], [0.2, 0.0, 0.0]),
    ]
    for tolerance in ((0.001, 0.01), (0.01, 0.1)):
        motion = scene.plan_along(
            Q_START, poses, position_tolerance=tolerance[0], rotation_tolerance=tolerance[1], **LIMITS
        )
        assert motion.status == "solved", motion.reason
        assert motion.trajectory is not None
        np.testing.assert_array_equal(motion.trajectory.positions[0], Q_START)
        assert_follows(panda, motion.trajectory, poses, tolerance)
    again = scene.plan_along(Q_START, poses, position_tolerance=0.01, rotation_tolerance=0.1, **LIMITS)
    assert again.trajectory is not None
    np.testing.assert_array_equal(again.trajectory.positions, motion.trajectory.positions)


@pytest.mark.parametrize("shift", [0.0, 1e-5, 1e-4, 5e-4])
def test_a_rotation_may_have_a_small_shift(shift: float, panda: kpam.Robot) -> None:
    scene, first = kpam.Scene(panda), np.asarray(panda.forward_kinematics(Q_START))
    for turn in ([0.5, 0.0, 0.0], [0.0, -0.5, 0.0], [0.0, 0.0, 0.5], [0.2, 0.3, 0.3]):
        poses = [moved(first, [0.0, shift, 0.0], turn)]
        motion = scene.plan_along(Q_START, poses, **LIMITS)
        assert motion.trajectory is not None, motion.reason
        assert_follows(panda, motion.trajectory, poses, (0.001, 0.01))


@pytest.mark.parametrize("length", [1e-10, 1e200])
def test_a_free_axis_may_have_any_length(length: float, panda: kpam.Robot) -> None:
    scene, first = kpam.Scene(panda), np.asarray(panda.forward_kinematics(Q_START))
    poses = [moved(first, [0.0, 0.1, 0.0])]
    motions = [scene.plan_along(Q_START, poses, free_axis=[0, 0, z], **LIMITS) for z in (1.0, length)]
    assert all(motion.status == "solved" for motion in motions), motions[1].reason
    np.testing.assert_allclose(motions[1].trajectory.positions, motions[0].trajectory.positions, atol=1e-9)


def test_a_straight_line_in_parts_is_passed_without_a_stop(panda: kpam.Robot) -> None:
    scene, first = kpam.Scene(panda), np.asarray(panda.forward_kinematics(Q_START))
    poses = [moved(first, [0.0, 0.1 * k, 0.0]) for k in (1, 2, 3)]
    parts = scene.plan_along(Q_START, poses, **LIMITS).trajectory
    whole = scene.plan_along(Q_START, poses[-1:], **LIMITS).trajectory
    assert parts is not None
    assert whole is not None
    assert parts.duration < 1.1 * whole.duration
    assert_follows(panda, parts, poses, (0.001, 0.01))


def test_a_free_axis_reaches_what_a_fixed_orientation_does_not(panda: kpam.Robot) -> None:
    scene, first = kpam.Scene(panda), np.asarray(panda.forward_kinematics(Q_START))
    # The last joint cannot turn this far.
    poses = [moved(first, [0.0, 0.05, 0.0], [0.0, 0.0, 1.5]), moved(first, [0.0, 0.1, 0.0], [0.0, 0.0, 3.0])]
    poses.append(moved(first, [0.0, 0.15, 0.0], [0.0, 0.0, 4.5]))
    fixed = scene.plan_along(Q_START, poses, **LIMITS)
    assert fixed.status == "unreachable"
    assert re.search(r"% of the line to poses\[\d\]: panda_joint\d is at its (lower|upper) limit, -?\d", fixed.reason)
    free = scene.plan_along(Q_START, poses, free_axis=[0, 0, 1], **LIMITS)
    assert free.trajectory is not None, free.reason
    assert_follows(panda, free.trajectory, poses, (0.001, 0.01), [0.0, 0.0, 1.0])


def test_a_pose_that_the_hand_has_needs_no_motion(panda: kpam.Robot) -> None:
    scene, first = kpam.Scene(panda), np.asarray(panda.forward_kinematics(Q_START))
    motion = scene.plan_along(Q_START, [first, first], **LIMITS)
    assert motion.trajectory is not None, motion.reason
    assert motion.trajectory.duration < 0.1
    np.testing.assert_allclose(motion.trajectory.positions[-1], Q_START, atol=1e-6)


def test_a_pose_out_of_reach_is_named(panda: kpam.Robot) -> None:
    scene, first = kpam.Scene(panda), np.asarray(panda.forward_kinematics(Q_START))
    motion = scene.plan_along(Q_START, [moved(first, [0.0, 0.1, 0.0]), moved(first, [1.0, 0.0, 0.0])], **LIMITS)
    assert (motion.status, motion.trajectory) == ("unreachable", None)
    assert "poses[1]" in motion.reason


def test_obstacles_are_kept_from_and_named(panda: kpam.Robot) -> None:
    first = np.asarray(panda.forward_kinematics(Q_START))
    poses = [moved(first, [0.0, 0.15, 0.0]), moved(first, [0.0, 0.3, 0.0])]
    beside = moved(np.eye(4), [*(first[:3, 3] + [0.16, 0.15, 0.0])])
    scene = kpam.Scene(panda, [kpam.Body("post", "rigid", [kpam.Shape.capsule(0.04, 0.4)], beside)])
    motion = scene.plan_along(Q_START, poses, **LIMITS)
    assert motion.trajectory is not None, motion.reason
    near = scene.check(motion.trajectory.sample_every(0.01), 0.0049)
    assert all(row == [] for row in near)
    inside = moved(np.eye(4), [*(first[:3, 3] + [0.0, 0.4, 0.0])])
    blocked = kpam.Scene(panda, [kpam.Body("ball", "rigid", [kpam.Shape.sphere(0.03)], inside)])
    motion = blocked.plan_along(Q_START, poses, **LIMITS)
    assert motion.status == "not_found"
    assert "poses[1]" in motion.reason
    assert "ball" in motion.reason


def test_redundant_joints_move_the_elbow_out_of_the_way(panda: kpam.Robot) -> None:
    first = np.asarray(panda.forward_kinematics(Q_START))
    poses = [moved(first, [0.0, 0.25, 0.0])]
    plain = kpam.Scene(panda).plan_along(Q_START, poses, **LIMITS).trajectory
    assert plain is not None
    elbow = np.asarray(panda.forward_kinematics(plain.positions[-1], "panda_link4"))
    solved = 0
    for shift in ([0.0, 0.11, 0.0], [0.0, 0.13, 0.0], [0.0, 0.12, 0.05], [0.0, 0.12, 0.1]):
        ball = kpam.Body("ball", "rigid", [kpam.Shape.sphere(0.03)], moved(np.eye(4), [*(elbow[:3, 3] + shift)]))
        scene = kpam.Scene(panda, [ball])
        if all(row == [] for row in scene.check(plain.sample_every(0.01), 0.005)):
            continue
        motion = scene.plan_along(Q_START, poses, **LIMITS)
        if motion.trajectory is not None:
            solved += 1
            # Bodies that are closer at the end keep the distance that they have there.
            nearer = {frozenset((a, b)): distance for a, b, distance in motion.nearer}
            for near in itertools.chain(*scene.check(motion.trajectory.sample_every(0.01), 0.0049)):
                assert near["distance"] >= nearer[frozenset(near["bodies"])] - 1e-4
            assert_follows(panda, motion.trajectory, poses, (0.001, 0.01))
    assert solved >= 1


def test_wrong_arguments_are_refused(panda: kpam.Robot) -> None:
    scene, pose = kpam.Scene(panda), np.asarray(panda.forward_kinematics(Q_START))
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"poses": []}, "poses"),
        ({"poses": [pose, pose[:3]]}, re.escape("poses[1]")),
        ({"poses": [2 * pose]}, re.escape("poses[0]")),
        ({"position_tolerance": 0.0}, "position_tolerance"),
        ({"rotation_tolerance": np.nan}, "rotation_tolerance"),
        ({"free_axis": [0, 0, 0]}, "free_axis"),
        ({"margin": 1.0}, "margin"),
        ({"q_start": Q_START * np.nan}, "q_start"),
    ]
    for arguments, field in wrong:
        with pytest.raises(kpam.ProblemError, match=field):
            scene.plan_along(**{"q_start": Q_START, "poses": [pose], **arguments})
    for name in ("link", "start_velocity", "speed"):
        with pytest.raises(TypeError, match=f"unexpected keyword argument '{name}'"):
            scene.plan_along(Q_START, [pose], **{name: None})
    with pytest.raises(TypeError) as caught:
        scene.plan_to(Q_START, Q_START, margin="wide")  # type: ignore[arg-type]
    assert caught.value.__notes__ == ["while processing 'margin'"]

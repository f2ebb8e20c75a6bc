"""Inverse kinematics: every reachable pose is solved; the best, the collision-free and all solutions are found."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gensim2_kpam as kpam
from gensim2.core.seeding import rng

from .kpam_scenes import Q_START
from .random_problems import robot_of
from .six_arms import ARMS, six_arm

Array = np.ndarray
HOME = np.array([0.3, 0.2, -0.4, -1.9, 0.3, 2.1, 0.6, 0.02, 0.02])
WEIGHTS = np.array([1.0, 2.0, 0.5, 1.0, 4.0, 1.0, 0.2, 0.0, 0.0])


def configurations(robot: kpam.Robot, count: int, seed: int) -> Array:
    low, high = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
    return np.asarray(robot.apply_mimic(rng(seed, "ik", 0).uniform(low, high, (count, len(low)))))


def manipulability(robot: kpam.Robot, q: Array) -> float:
    jacobian = np.asarray(robot.jacobian(q))
    return float(np.sqrt(np.linalg.det(jacobian @ jacobian.T)))


def tangential(robot: kpam.Robot, q: Array, gradient: Array) -> Array:
    """Return the part of a gradient along motions that keep the hand's pose; joints at their limits do not move."""
    room = np.minimum(q - robot.lower, robot.upper - q)
    free = (room > 1e-6) & (np.abs(np.asarray(robot.jacobian(q))).max(axis=0) > 0)
    columns = np.asarray(robot.jacobian(q))[:, free].T
    force, *_ = np.linalg.lstsq(columns, gradient[free], rcond=None)
    return np.asarray(gradient[free] - columns @ force)


@pytest.mark.parametrize("name", ARMS)
def test_one_solution_is_found_for_every_reachable_pose(name: str, robots: Path, tmp_path: Path) -> None:
    robot = robot_of(six_arm(name, robots)[0], tmp_path)
    scene = kpam.Scene(robot)
    middle = configurations(robot, 1, 1)[0]
    poses = np.asarray(robot.forward_kinematics(configurations(robot, 300, 2)))
    found = [scene.ik(pose, middle, max_solutions=1) for pose in poses]
    assert sum(len(each) for each in found) >= 0.998 * 300
    for pose, each in zip(poses, found, strict=True):
        for q in each:
            np.testing.assert_allclose(robot.forward_kinematics(q), pose, atol=1e-6)


def test_a_posture_gives_the_solutions_of_least_cost(panda: kpam.Robot) -> None:
    scene = kpam.Scene(panda)

    def cost(q: Array) -> float:
        return float((WEIGHTS * (q - HOME) ** 2).sum())

    stationary = 0
    for q in configurations(panda, 10, 3):
        pose = panda.forward_kinematics(q)
        found = scene.ik(pose, Q_START, max_solutions=4, posture=HOME, posture_weights=WEIGHTS)
        assert len(found) >= 1
        costs = [cost(each) for each in found]
        assert costs == sorted(costs)
        plain = [cost(each) for each in scene.ik(pose, Q_START, max_solutions=64, seed=1)]
        assert costs[0] <= min(plain) + 1e-6
        for each in found:
            np.testing.assert_allclose(panda.forward_kinematics(each), pose, atol=1e-6)
            rest = tangential(panda, each, 2 * WEIGHTS * (each - HOME))
            stationary += bool(np.abs(rest).max() < 1e-2)
            assert (each[7:] == Q_START[7:]).all()
    assert stationary >= 30


def test_solutions_of_high_manipulability_come_first(panda: kpam.Robot) -> None:
    scene = kpam.Scene(panda)
    for q in configurations(panda, 10, 4):
        pose = panda.forward_kinematics(q)
        found = scene.ik(pose, Q_START, max_solutions=4, manipulability=1.0)
        values = [manipulability(panda, each) for each in found]
        assert values == sorted(values, reverse=True)
        plain = [manipulability(panda, each) for each in scene.ik(pose, Q_START, max_solutions=64, seed=1)]
        assert values[0] >= max(plain) - 1e-6
        # No other configuration in the neighbourhood with the same pose is better.
        slope = np.zeros(9)
        for j in range(7):
            step = 1e-6 * np.eye(9)[j]
            slope[j] = (manipulability(panda, found[0] + step) - manipulability(panda, found[0] - step)) / 2e-6
        assert np.abs(tangential(panda, found[0], slope)).max() < 1e-2


def clutter(seed: int) -> list[kpam.Body]:
    draw, bodies = rng(seed, "ik boxes", 0), []
    for k in range(60):
        pose = np.eye(4)
        pose[:3, 3] = draw.uniform([-0.7, -0.7, 0.1], [0.7, 0.7, 0.9])
        if np.hypot(*pose[:2, 3]) > 0.3:
            bodies.append(kpam.Body(f"box{k}", "rigid", [kpam.Shape.box(draw.uniform(0.03, 0.09, 3))], pose))
    return bodies


def test_with_a_margin_all_solutions_keep_it(panda: kpam.Robot) -> None:
    margin = 0.01
    scene = kpam.Scene(panda, clutter(1))
    drawn = configurations(panda, 400, 5)
    drawn[:, 7:] = Q_START[7:]
    reachable = [q for q in drawn if not scene.check(q, margin)]
    assert len(reachable) > 60
    found, blocked = 0, 0
    for q in reachable[:60]:
        pose = panda.forward_kinematics(q)
        blocked += bool(scene.check(scene.ik(pose, Q_START, max_solutions=1)[0], margin))
        some = scene.ik(pose, Q_START, max_solutions=1, margin=margin)
        best = scene.ik(pose, Q_START, max_solutions=3, margin=margin, posture=HOME)
        found += len(some)
        for each in (*some, *best):
            assert scene.check(each, margin - 1e-6) == []
            np.testing.assert_allclose(panda.forward_kinematics(each), pose, atol=1e-6)
    assert blocked >= 10, "the boxes are in the way"
    assert found >= 59


def test_all_solutions_of_a_scara_are_those_of_the_closed_form(robots: Path, tmp_path: Path) -> None:
    robot = robot_of(six_arm("scara", robots)[0], tmp_path)
    scene = kpam.Scene(robot)
    upper, fore = 0.35, 0.29
    several = 0
    for q in configurations(robot, 60, 6):
        pose = np.asarray(robot.forward_kinematics(q))
        x, y = pose[:2, 3]
        turn = q[0] + q[1] - q[3]  # the hand points down, so its joint turns it the other way
        expected = []
        elbow = np.arccos(np.clip((x * x + y * y - upper**2 - fore**2) / (2 * upper * fore), -1, 1))
        if elbow < 0.05:
            continue  # both solutions count as the same
        for e in (elbow, -elbow):
            shoulder = np.arctan2(y, x) - np.arctan2(fore * np.sin(e), upper + fore * np.cos(e))
            for turns in np.arange(-2, 3) * 2 * np.pi:
                for more in np.arange(-1, 2) * 2 * np.pi:
                    each = np.array([shoulder + more, e, q[2], shoulder + more + e - turn + turns])
                    if (each >= robot.lower - 1e-9).all() and (each <= robot.upper + 1e-9).all():
                        expected.append(each)
        found = scene.ik(pose, q, max_solutions=256)
        assert len(found) == len(expected)
        for each in expected:
            assert np.abs(found - each).max(axis=1).min() < 1e-5
        several += len(expected) > 1
    assert several >= 30


def test_all_solutions_of_six_joints_do_not_depend_on_the_seed(robots: Path, tmp_path: Path) -> None:
    arm, _ = six_arm("ur", robots)
    file = tmp_path / "arm.urdf"
    file.write_text(arm.urdf.replace('lower="-6.2" upper="6.2"', 'lower="-3.14" upper="3.14"'))
    robot = kpam.Robot.from_urdf(file, hand_link=arm.hand)
    scene = kpam.Scene(robot)
    most = 0
    for q in configurations(robot, 10, 7):
        pose = robot.forward_kinematics(q)
        first, second = (scene.ik(pose, q, max_solutions=256, seed=seed) for seed in (0, 1))
        assert len(first) == len(second) <= 8
        assert np.abs(first[:, None] - second[None]).max(axis=2).min(axis=1).max() < 1e-4
        np.testing.assert_allclose(first[0], q, atol=1e-5)
        most = max(most, len(first))
    assert most >= 4


def test_solutions_differ_by_the_distance_that_is_asked(panda: kpam.Robot) -> None:
    scene, pose = kpam.Scene(panda), panda.forward_kinematics(HOME)
    close = scene.ik(pose, Q_START, max_solutions=40, min_distance=0.01)
    far = scene.ik(pose, Q_START, max_solutions=40, min_distance=1.0)
    for found, least in ((close, 0.01), (far, 1.0)):
        apart = np.abs(found[:, None] - found[None]).max(axis=2) + 10 * np.eye(len(found))
        assert apart.min() >= least
    assert 1 < len(far) < len(close) == 40


def test_wrong_arguments_are_refused(panda: kpam.Robot) -> None:
    scene, pose = kpam.Scene(panda), panda.forward_kinematics(HOME)
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"max_solutions": 0}, "max_solutions"),
        ({"min_distance": 0.0}, "min_distance"),
        ({"min_distance": float("nan")}, "min_distance"),
        ({"posture": HOME[:7]}, "posture"),
        ({"posture": HOME * 10}, "posture"),
        ({"posture_weights": WEIGHTS}, "posture_weights"),
        ({"posture": HOME, "posture_weights": -WEIGHTS}, re.escape("posture_weights[0]")),
        ({"manipulability": -1.0}, "manipulability"),
        ({"manipulability": float("nan")}, "manipulability"),
        ({"margin": -0.1}, "margin"),
        ({"margin": 0.2}, "margin"),
        ({"link": "no"}, "link"),
    ]
    for arguments, field in wrong:
        with pytest.raises(kpam.ProblemError, match=field):
            scene.ik(pose, Q_START, **arguments)

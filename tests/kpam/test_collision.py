"""Collision checks of many configurations; tests/bench compares them with coal's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gensim2_kpam as kpam

from . import kpam_scenes


def arm_among(panda: kpam.Robot, bodies: list[kpam.Body]) -> kpam.KeypointProblem:
    return kpam_scenes.problem(panda, bodies=bodies)


def test_a_ball_at_the_hand_is_hit_and_one_far_away_is_not(panda: kpam.Robot) -> None:
    hand = panda.forward_kinematics(kpam_scenes.Q_START)
    for offset, expected in ((0.0, True), (1.5, False)):
        pose = np.eye(4)
        pose[:3, 3] = hand[:3, 3] + [0.0, 0.0, offset]
        ball = kpam.Body("ball", "rigid", [kpam.Shape.sphere(0.03)], pose)
        assert arm_among(panda, [ball]).scene.in_collision(kpam_scenes.Q_START) is expected


def test_the_arm_hits_itself_folded_and_not_at_rest(panda: kpam.Robot) -> None:
    folded = kpam_scenes.Q_START.copy()
    folded[[1, 3]] = [1.7, -3.0]
    found = arm_among(panda, []).scene.in_collision(np.stack([kpam_scenes.Q_START, folded]))
    assert found.dtype == np.bool_
    assert found.tolist() == [False, True]


def test_a_wrong_row_is_refused(panda: kpam.Robot) -> None:
    problem = arm_among(panda, [])
    for q in (np.zeros(3), np.zeros((2, 8)), np.full(9, np.nan)):
        with pytest.raises(kpam.ProblemError, match="q"):
            problem.scene.in_collision(q)


def test_points_of_the_robot_itself_are_no_obstacle(panda: kpam.Robot) -> None:
    q = np.array([0.3, -0.4, 0.2, -2.2, 0.1, 1.9, 0.6, 0.04, 0.04])
    held = kpam.Body("held", "attached", [kpam.Shape.sphere(0.03, [0.0, 0.0, 0.15])], np.eye(4))
    scene = kpam.Scene(panda, [held])
    draw = np.random.default_rng(4)
    seen, away = [], draw.uniform([-1, -1, 0], [1, 1, 1.3], (3000, 3))
    for name in panda.link_names:
        triangles = panda.surface(name)[0]
        if len(triangles):
            pose = panda.forward_kinematics(q, link=name)
            weights = draw.dirichlet([1.0, 1.0, 1.0], len(triangles))
            places = np.einsum("ij,ijk->ik", weights, triangles)
            seen.append(places @ pose[:3, :3].T + pose[:3, 3])
    of_robot = np.concatenate(seen) + draw.normal(0, 0.002, (sum(map(len, seen)), 3))
    assert scene.own_points(q, of_robot, clearance=0.015).all()
    hand = panda.forward_kinematics(q)
    centre = hand[:3, :3] @ [0, 0, 0.15] + hand[:3, 3]
    from_ball = np.linalg.norm(away - centre, axis=1) - 0.03
    marks = scene.own_points(q, away, clearance=0.1)
    assert marks[from_ball < 0.099].all()
    # The remaining distance agrees with a ball of this size around each point.
    cloud = kpam.Body("cloud", "rigid", [kpam.Shape.point_cloud(away[~marks], 0.09)], np.eye(4))
    assert not kpam.Scene(panda, [cloud]).in_collision(q) or kpam.Scene(panda).in_collision(q)
    near = away[marks & (from_ball > 0.101)]
    one = [kpam.Body(str(k), "rigid", [kpam.Shape.sphere(0.11, p)], np.eye(4)) for k, p in enumerate(near[:20])]
    assert all(kpam.Scene(panda, [ball]).in_collision(q) for ball in one)


@pytest.mark.parametrize("distance", [1.0, 3.0, 30.0, 900.0])
def test_stray_points_hide_no_collision(panda: kpam.Robot, distance: float) -> None:
    """Stray points are out of reach, so a cloud collides with the arm exactly where it does without them."""
    draw = np.random.default_rng(int(distance))
    points = draw.uniform([-0.8, -0.8, 0], [0.8, 0.8, 1.2], (60, 3))
    strays = draw.normal(size=(5, 3))
    strays *= (2.5 + distance) / np.linalg.norm(strays, axis=1, keepdims=True)
    rows = draw.uniform(panda.lower, panda.upper, (1000, len(panda.lower)))

    def hits(cloud: np.ndarray) -> np.ndarray:
        body = kpam.Body("cloud", "rigid", [kpam.Shape.point_cloud(cloud, 0.01)], np.eye(4))
        return np.asarray(kpam.Scene(panda, [body]).in_collision(rows))

    clean = hits(points)
    assert 0.1 < clean.mean() < 0.9
    np.testing.assert_array_equal(hits(np.concatenate([points, strays])), clean)


@pytest.mark.parametrize("distance", [1.1e3, 1e12, 1e38])
def test_points_beyond_a_kilometre_are_refused(distance: float) -> None:
    shape = kpam.Shape.point_cloud([[0.5, 0.0, 0.5], [distance, 0.0, 0.0]], 0.01)
    with pytest.raises(kpam.ProblemError, match="within 1000 m") as error:
        kpam.Body("cloud", "rigid", [shape], np.eye(4))
    assert error.value.field == "shapes[1]"


def test_a_distant_cloud_is_met_outside_the_limits_of_a_sliding_joint(tmp_path: Path) -> None:
    """A check accepts joint values beyond the limits, so reach must be computed from the pose."""
    urdf = tmp_path / "gantry.urdf"
    urdf.write_text(
        '<robot name="gantry"><link name="base"/><link name="car"><collision><geometry><sphere radius="0.1"/>'
        '</geometry></collision></link><joint name="rail" type="prismatic"><parent link="base"/><child link="car"/>'
        '<axis xyz="1 0 0"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>'
    )
    gantry = kpam.Robot.from_urdf(urdf, hand_link="car")
    points = np.random.default_rng(1).normal([10.0, 0.0, 0.0], 0.02, (50, 3))
    scene = kpam.Scene(gantry, [kpam.Body("cloud", "rigid", [kpam.Shape.point_cloud(points, 0.01)], np.eye(4))])
    assert [scene.in_collision([q]) for q in (0.0, 10.0)] == [False, True]

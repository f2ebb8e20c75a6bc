"""Motions to joint and pose goals: exact ends, free of collisions, reproducible."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gensim2_kpam as kpam
from gensim2.core.seeding import rng

Q_START = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785, 0.04, 0.04])
MARGIN = 0.005


def clutter(index: int, count: int = 8) -> list[kpam.Body]:
    """Boxes, cylinders and balls around the arm, none of them at its start."""
    draw = rng(7, "motions", index)
    bodies: list[kpam.Body] = []
    while len(bodies) < count:
        pose = np.eye(4)
        pose[:3, 3] = draw.uniform([-0.8, -0.8, 0.0], [0.8, 0.8, 1.0])
        shape = [
            kpam.Shape.box(draw.uniform(0.03, 0.15, 3)),
            kpam.Shape.cylinder(float(draw.uniform(0.02, 0.08)), float(draw.uniform(0.1, 0.5))),
            kpam.Shape.sphere(float(draw.uniform(0.03, 0.1))),
        ][len(bodies) % 3]
        bodies.append(kpam.Body(f"body {len(bodies)}", "rigid", [shape], pose))
    return bodies


def free_goal(scene: kpam.Scene, robot: kpam.Robot, index: int) -> np.ndarray | None:
    """Return a configuration that keeps the margin, if one of some draws does."""
    draw = rng(8, "motions", index)
    for _ in range(50):
        q = np.concatenate([draw.uniform(robot.lower[:7], robot.upper[:7]), [0.04, 0.04]])
        if scene.distance(q, 0.1) > MARGIN:
            return q
    return None


def solved(panda: kpam.Robot, count: int) -> list[tuple[kpam.Scene, np.ndarray, kpam.Motion]]:
    out = []
    for index in range(count):
        scene = kpam.Scene(panda, clutter(index))
        goal = free_goal(scene, panda, index)
        if goal is not None and scene.distance(Q_START, 0.1) > MARGIN:
            out.append((scene, goal, scene.plan_to(Q_START, goal, margin=MARGIN, max_checks=200_000)))
    assert len(out) > count // 3
    return out


def test_solved_motions_begin_and_end_where_they_should_and_keep_the_margin(panda: kpam.Robot) -> None:
    motions = solved(panda, 24)
    found = 0
    for scene, goal, motion in motions:
        if motion.status != "solved":
            assert motion.trajectory is None
            assert motion.reason
            continue
        found += 1
        assert motion.trajectory is not None
        samples = motion.trajectory.sample_every(0.005)
        np.testing.assert_allclose(samples[0], Q_START, atol=1e-9)
        np.testing.assert_allclose(samples[-1], goal, atol=1e-9)
        # Distances of the full measurement, which does not depend on sweeps.
        nearest = min((near["distance"] for row in scene.check(samples, 0.05) for near in row), default=1.0)
        assert nearest >= MARGIN - 2e-4
        speed = np.abs(motion.trajectory.sample(np.linspace(0, motion.trajectory.duration, 500))[1])
        assert (speed <= panda.velocity * (1 + 1e-9) + 1e-12).all()
    assert found >= 0.8 * len(motions)


def test_the_same_question_has_the_same_answer(panda: kpam.Robot) -> None:
    first, second = solved(panda, 6), solved(panda, 6)
    for (_, _, one), (_, _, two) in zip(first, second, strict=True):
        assert (one.status, one.checks) == (two.status, two.checks)
        if one.trajectory is not None and two.trajectory is not None:
            np.testing.assert_array_equal(one.trajectory.positions, two.trajectory.positions)


def test_any_of_several_goals_will_do(panda: kpam.Robot) -> None:
    pose = np.eye(4)
    blocked = Q_START + 0.4
    blocked[7:] = 0.04
    pose[:3, 3] = panda.forward_kinematics(blocked)[:3, 3]
    scene = kpam.Scene(panda, [kpam.Body("ball", "rigid", [kpam.Shape.sphere(0.05)], pose)])
    free = Q_START.copy()
    free[0] -= 0.8
    motion = scene.plan_to(Q_START, np.stack([blocked, free]))
    assert (motion.status, motion.goal) == ("solved", 1)
    refused = scene.plan_to(Q_START, blocked)
    assert refused.status == "goals_blocked"
    assert "ball" in refused.reason
    poses = panda.forward_kinematics(np.stack([blocked, blocked, free]))
    poses[0, :3, 3] += 3.0  # out of reach
    motion = scene.plan_to(Q_START, poses)
    assert (motion.status, motion.goal) == ("solved", 2)
    assert motion.trajectory is not None
    np.testing.assert_allclose(panda.forward_kinematics(motion.trajectory.positions[-1]), poses[2], atol=1e-6)
    assert scene.plan_to(Q_START, poses[:1]).status == "unreachable"
    for bad, field in ((poses[:0], "goal"), (2.0 * poses, "goal[0]"), (np.repeat(poses, 86, axis=0), "goal")):
        with pytest.raises(kpam.ProblemError) as refusal:
            scene.plan_to(Q_START, bad)
        assert refusal.value.field == field


def test_a_start_inside_something_is_said(panda: kpam.Robot) -> None:
    scene = kpam.Scene(
        panda, [kpam.Body("ball", "rigid", [kpam.Shape.sphere(0.05)], panda.forward_kinematics(Q_START))]
    )
    motion = scene.plan_to(Q_START, Q_START + np.array([0.5] + [0.0] * 8))
    assert motion.status == "start_blocked"
    assert "ball" in motion.reason


def test_poses_are_met_and_solutions_are_distinct(panda: kpam.Robot) -> None:
    scene = kpam.Scene(panda)
    goal = panda.forward_kinematics(np.array([0.4, 0.2, -0.3, -2.0, 0.2, 2.2, 0.5, 0.04, 0.04]))
    found = scene.ik(goal, Q_START, max_solutions=12)
    assert len(found) == 12
    np.testing.assert_allclose(panda.forward_kinematics(found), np.broadcast_to(goal, (12, 4, 4)), atol=1e-6)
    assert (found >= panda.lower - 1e-9).all()
    assert (found <= panda.upper + 1e-9).all()
    apart = np.abs(found[:, None] - found[None]).max(axis=2) + np.eye(12)
    assert apart.min() > 0.05 - 1e-9
    motion = scene.plan_to(Q_START, goal)
    assert motion.trajectory is not None
    np.testing.assert_allclose(panda.forward_kinematics(motion.trajectory.positions[-1]), goal, atol=1e-6)
    elbow = panda.forward_kinematics(found[0], "panda_link5")
    there = scene.plan_to(Q_START, elbow, link="panda_link5")
    assert there.trajectory is not None
    np.testing.assert_allclose(
        panda.forward_kinematics(there.trajectory.positions[-1], "panda_link5"), elbow, atol=1e-6
    )
    far = goal.copy()
    far[:3, 3] = [2.0, 0.0, 0.5]
    assert scene.plan_to(Q_START, far).status == "unreachable"


def _at(place: list[float]) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = place
    return pose


def test_clouds_are_kept_from_like_the_boxes_that_they_cover(panda: kpam.Robot) -> None:
    draw = rng(9, "motions", 0)
    half = np.array([0.1, 0.3, 0.2])
    points = draw.uniform(-half, half, (4000, 3))
    face = draw.integers(0, 3, 4000)
    points[np.arange(4000), face] = np.sign(points[np.arange(4000), face]) * half[face]
    pose = _at([0.55, 0.0, 0.2])
    cloud = kpam.Scene(panda, [kpam.Body("cloud", "rigid", [kpam.Shape.point_cloud(points, 0.01)], pose)])
    start, goal = Q_START.copy(), Q_START.copy()
    start[[0, 1, 3]], goal[[0, 1, 3]] = [-0.9, 0.5, -1.6], [0.9, 0.5, -1.6]
    motion = cloud.plan_to(start, goal, margin=MARGIN)
    assert motion.status == "solved", motion.reason
    assert motion.trajectory is not None
    samples = motion.trajectory.sample_every(0.02)
    nearest = min((near["distance"] for row in cloud.check(samples, 0.03) for near in row), default=1.0)
    assert nearest >= MARGIN - 2e-4


def test_checks_in_a_batch_are_single_checks_and_full_measurement(panda: kpam.Robot) -> None:
    scene = kpam.Scene(panda, clutter(5, 30))
    q = rng(10, "motions", 0).uniform(panda.lower, panda.upper, (300, 9))
    batch = np.asarray(scene.in_collision(q))
    assert 0 < batch.sum() < 300
    np.testing.assert_array_equal(batch, [scene.in_collision(row) for row in q])
    full = scene.check(q, 0.0)
    np.testing.assert_array_equal(batch, [any(near["distance"] < 0 for near in row) for row in full])
    distances = np.asarray(scene.distance(q, 0.2))
    wanted = [min([near["distance"] for near in row], default=0.2) for row in scene.check(q, 0.2)]
    apart = np.asarray(wanted) > 0
    np.testing.assert_allclose(distances[apart], np.asarray(wanted)[apart], atol=1e-7)
    np.testing.assert_array_equal(distances < 0, np.asarray(wanted) < 0)


@pytest.mark.parametrize(
    ("start", "goal"),
    [
        ([0.07, 0.13, -2.24, 2.82, -1.18, -0.48], [2.06, -1.73, 0.31, -2.97, 1.59, 0.24]),
        ([-1.07, -0.43, -1.24, -0.29, -2.3, -0.61], [-1.86, -2.24, 1.57, -1.38, -0.09, 3.02]),
        ([-2.48, -0.96, -0.75, 1.42, 0.97, -0.43], [2.31, -0.97, 1.95, -0.99, 0.27, -1.91]),
    ],
)
def test_links_that_are_always_close_do_not_block_motions(start: list[float], goal: list[float]) -> None:
    """Two links of this UR5e are 0.5 to 0.8 mm apart, and closer between the start and the goal than at both."""
    ur5e = Path(__file__).parents[2] / "examples" / "robots" / "ur5e.urdf"
    scene = kpam.Scene(kpam.Robot.from_urdf(ur5e, hand_link="flange"))
    motion = scene.plan_to(start, goal, samples=3000)
    assert motion.status == "solved", motion.reason
    assert motion.trajectory is not None
    assert [pair[:2] for pair in motion.nearer] == [("base_link", "upper_arm_link")]
    for row in scene.check(motion.trajectory.sample_every(0.01), MARGIN - 2e-4):
        for pair in row:
            assert pair["bodies"] == ("base_link", "upper_arm_link")
            assert pair["distance"] > 0.0


def test_links_whose_gap_varies_about_the_margin_do_not_block_motions(tmp_path: Path) -> None:
    """The collar turns about an axis 1 mm beside the centre of the ball: its gap is 6 mm at both ends, 4 mm between."""

    def link(name: str, radius: float, x: float) -> str:
        shape = f'<origin xyz="{x} 0 0"/><geometry><sphere radius="{radius}"/></geometry>'
        return f'<link name="{name}"><collision>{shape}</collision></link>'

    def joint(name: str, parent: str, child: str) -> str:
        limit = '<limit lower="-3.1" upper="3.1" velocity="1" effort="1"/>'
        ends = f'<parent link="{parent}"/><child link="{child}"/><axis xyz="0 0 1"/>'
        return f'<joint name="{name}" type="revolute">{ends}{limit}</joint>'

    links = link("ball", 0.05, 0.001) + link("ring", 0.01, 0.0) + link("collar", 0.02, 0.075)
    urdf = tmp_path / "collar.urdf"
    joints = joint("turn", "ball", "ring") + joint("slack", "ring", "collar")
    urdf.write_text(f'<robot name="collar">{links}{joints}</robot>', encoding="utf-8")
    scene = kpam.Scene(kpam.Robot.from_urdf(urdf, hand_link="collar"))
    motion = scene.plan_to([-3.0, 0.0], [3.0, 0.0], samples=2000)
    assert motion.status == "solved", motion.reason
    assert motion.trajectory is not None
    gaps = np.asarray(scene.distance(motion.trajectory.sample_every(0.01), 0.1))
    assert 0.0039 < gaps.min() < 0.0041


@pytest.mark.parametrize("name", ["box", "sphere", "capsule", "cylinder", "convex_hull", "mesh", "point_cloud"])
def test_the_help_of_each_shape_states_its_unit(name: str) -> None:
    text = getattr(kpam.Shape, name).__doc__
    assert "(m)" in text or ", m" in text or "(m," in text


def test_many_motions_are_those_of_single_calls(panda: kpam.Robot) -> None:
    scene = kpam.Scene(panda, clutter(5, 8))
    q = rng(11, "motions", 0).uniform(panda.lower, panda.upper, (200, 9))
    q[:, 7:] = 0.04
    free = q[~np.asarray(scene.in_collision(q))]
    starts, goals = free[:12], [*free[12:22], panda.forward_kinematics(free[22]), free[23:26]]
    options: dict[str, Any] = {"margin": 0.01, "velocity_scale": 0.5, "samples": 3000}
    single = [scene.plan_to(start, goal, **options) for start, goal in zip(starts, goals, strict=True)]
    assert sum(motion.trajectory is not None for motion in single) >= 8
    for threads in (1, 2, None):
        many = scene.plan_to_many(starts, goals, threads=threads, **options)
        for one, other in zip(single, many, strict=True):
            assert (one.status, one.reason, one.goal, one.checks) == (
                other.status,
                other.reason,
                other.goal,
                other.checks,
            )
            if one.trajectory is not None:
                assert other.trajectory is not None
                np.testing.assert_array_equal(one.trajectory.positions, other.trajectory.positions)
                np.testing.assert_array_equal(one.trajectory.times, other.trajectory.times)
    assert scene.plan_to_many([], []) == []
    stopped = kpam.Cancel()
    stopped.cancel()
    assert {m.status for m in scene.plan_to_many(starts, goals, cancel=stopped)} == {"cancelled"}


def test_many_motions_refuse_a_wrong_pair_by_its_number(panda: kpam.Robot) -> None:
    scene = kpam.Scene(panda)
    outside, short = Q_START + 9.0 * np.eye(9)[0], Q_START[:4]
    for starts, goals, more, field in (
        ([Q_START, outside], [Q_START, Q_START], {}, r"q_starts\[1\]\[0\]"),
        ([Q_START, Q_START], [Q_START, outside], {}, r"goals\[1\]\[0\]\[0\]"),
        ([Q_START, short], [Q_START, Q_START], {}, r"q_starts\[1\]"),
        ([Q_START], [short], {}, r"goals\[0\]"),
        ([Q_START], [Q_START, Q_START], {}, "goals"),
        ([Q_START], [Q_START], {"threads": 0}, "threads"),
        ([Q_START], [Q_START], {"margin": 5.0}, "margin"),
    ):
        with pytest.raises(kpam.ProblemError, match=field):
            scene.plan_to_many(starts, goals, **more)
    with pytest.raises(TypeError, match="'speed'"):
        scene.plan_to_many([Q_START], [Q_START], speed=1.0)

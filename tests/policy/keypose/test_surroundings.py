"""Collision scenes from point clouds: obstacles are avoided, except points in contact at the start or the goal."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from gensim2.policy.keypose.execution import Executor
from gensim2.policy.keypose.paths import GRAZE, joint_path
from gensim2.policy.keypose.program import ACTUATION, KEYPOSES, KeyposeProgram
from gensim2.policy.keypose.surroundings import EVERY, POINT_RADIUS, Seen, Surroundings
from gensim2.robots import robot

PROFILE = robot("panda")
HOME = np.array(PROFILE.reset_qpos)
CLOSED = np.append(HOME[:7], [0.018, 0.018])
AROUND = Surroundings(PROFILE)


def _turned(angle: float) -> np.ndarray:
    """Return the rest pose turned about the base's z axis."""
    q = HOME.copy()
    q[0] = angle
    return q


def _grip(q: np.ndarray) -> np.ndarray:
    hand = PROFILE.model.forward_kinematics(q)
    return hand[:3, 3] + 0.1034 * hand[:3, 2]


def _seen(points: np.ndarray, holds: bool = False) -> Seen:
    return AROUND.seen(points, CLOSED if holds else HOME, holds)


def _hands(actions: np.ndarray) -> np.ndarray:
    joints = np.column_stack([actions[:, :7], np.full((len(actions), 2), 0.04)])
    return PROFILE.model.forward_kinematics(joints)[:, :3, 3]


@pytest.mark.parametrize("holds", [False, True])
def test_a_point_in_the_way_at_the_goal_does_not_hide_the_others(holds: bool) -> None:
    wall = PROFILE.model.forward_kinematics(_turned(0.5))[:3, 3]
    wall = wall + np.random.default_rng(0).uniform(-0.03, 0.03, (60, 3))
    goal = _turned(1.0)
    in_hand = PROFILE.model.forward_kinematics(goal)[:3, 3] + np.array([[0.0, 0.0, 0.02]])
    ball = _grip(HOME) + 0.015 * np.random.default_rng(1).uniform(-1, 1, (8, 3))
    points = np.vstack([wall, in_hand, *([ball] if holds else [])])
    seen = _seen(points, holds)
    assert len(seen.held) == (8 if holds else 0)
    found = Executor(PROFILE).rest(CLOSED if holds else HOME, goal, -0.2 if holds else 1.0, seen)
    assert found.free == "but for touched"
    assert np.linalg.norm(_hands(found.actions)[:, None] - wall, axis=-1).min() > 0.03
    alone = Executor(PROFILE).rest(HOME, goal, 1.0, _seen(np.zeros((0, 3))))
    assert np.linalg.norm(_hands(alone.actions)[:, None] - wall, axis=-1).min() < 0.03


def test_what_is_held_on_the_table_is_moved_clear_of_the_table_all_the_same() -> None:
    down = PROFILE.model.forward_kinematics(HOME).copy()
    down[2, 3] = 0.13
    (q, *_) = AROUND.bare.ik(down, CLOSED, max_solutions=1)
    q = np.append(q[:7], CLOSED[7:])
    held = _grip(q) + 0.012 * np.random.default_rng(0).uniform(-1, 1, (30, 3))
    held[:, 2] = np.clip(held[:, 2] - 0.02, 0.002, None)
    seen = AROUND.seen(held, q, holds=True)
    assert (len(seen.standing), len(seen.held)) == (0, 30)
    goal = q.copy()
    goal[0] += 1.0
    assert Executor(PROFILE).rest(q, goal, -0.2, seen).free == "table only"


def test_only_points_that_the_arm_overlaps_are_left_out() -> None:
    hand = PROFILE.model.forward_kinematics(HOME)[:3, 3]
    points = np.stack([hand, hand + np.array([0.0, 0.5, 0.0]), _grip(_turned(1.0)) + np.array([0.0, 0.0, 0.08])])
    seen = _seen(points)
    assert np.array_equal(AROUND.untouched(seen, HOME).standing, points[1:])
    assert np.array_equal(AROUND.untouched(seen, HOME, _turned(1.0)).standing, points[1:2])
    assert np.array_equal(AROUND.untouched(seen, _turned(-1.0)).standing, points)


def test_the_hand_may_touch_what_it_likes_and_the_arm_may_not() -> None:
    elbow = PROFILE.model.forward_kinematics(HOME, "panda_link5")[:3, 3]
    touched = _seen(_grip(HOME)[None] + np.array([[0.0, 0.0, 0.03]]))
    assert AROUND.depth_in(touched)(HOME[None]) == 0.0
    ways = np.stack([_turned(1.5)] * EVERY + [HOME])
    assert AROUND.depth_in(_seen(elbow[None]))(ways) > POINT_RADIUS
    assert AROUND.depth_in(_seen(elbow[None]))(ways[:EVERY]) == 0.0
    assert AROUND.depth_in(_seen(np.zeros((0, 3))))(HOME[None]) == 0.0


def test_of_the_arms_postures_one_that_keeps_out_of_the_cloud_is_taken() -> None:
    pose = PROFILE.model.forward_kinematics(HOME)
    positions = np.repeat(pose[None, :3, 3], KEYPOSES, 0)
    positions[:ACTUATION, 2] += 0.05
    program = KeyposeProgram(
        positions=positions.astype(np.float32),
        rotations=np.repeat(pose[None, :3, :3], KEYPOSES, 0).astype(np.float32),
        gripper=np.ones(KEYPOSES + 1, np.float32),
        seconds=np.full(KEYPOSES, 0.2, np.float32),
    )
    first = joint_path(program, HOME, AROUND.bare, lambda joints: 0.0)
    assert first is not None
    elbow = PROFILE.model.forward_kinematics(first.joints[first.at[ACTUATION]], "panda_link4")[:3, 3]
    seen = _seen(elbow + np.random.default_rng(0).uniform(-0.04, 0.04, (20, 3)))
    assert AROUND.depth_in(seen)(first.joints) > GRAZE
    other = joint_path(program, HOME, AROUND.bare, AROUND.depth_in(seen))
    assert other is not None
    assert other.is_whole
    assert other.depth <= GRAZE
    assert np.allclose(PROFILE.model.forward_kinematics(other.joints[other.at[ACTUATION]])[:3, 3], pose[:3, 3])


def test_motions_keep_the_limits_that_a_robot_says_of_itself() -> None:
    slow = dataclasses.replace(
        PROFILE, solver={**PROFILE.solver, "acceleration_limits": [1.0] * 9, "jerk_limits": [500.0] * 9}
    )
    goal, nothing = _turned(1.0), _seen(np.zeros((0, 3)))
    usual, found = (Executor(each).rest(HOME, goal, 1.0, nothing).actions for each in (PROFILE, slow))
    # From rest to rest over 1 rad, at half of 1 rad/s^2: 2 sqrt(1 / 0.5) s.
    assert len(found) > 2 * np.sqrt(2.0) * PROFILE.control_hz > len(usual)

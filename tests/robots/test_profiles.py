"""Profiles agree with the URDF, the planner and ManiSkill's agent."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from constraints import point_to_point, pointing_down

import gensim2_kpam as kpam
from gensim2.core.errors import InputError
from gensim2.objects.placement import STANDARD_REGION
from gensim2.robots import CLOSED, OPEN, load_robot, robot

pytest.importorskip("mani_skill")


def test_joints_are_those_of_the_planner_in_its_order(any_robot: str) -> None:
    profile = robot(any_robot)
    assert profile.model.joint_names == [*profile.arm_joints, *profile.gripper.joints]
    q = np.array(profile.reset_qpos)
    # In some models, the finger values are slightly less than their range.
    assert (q >= profile.model.lower - 1e-6).all()
    assert (q <= profile.model.upper + 1e-6).all()
    assert profile.action_size == len(profile.arm_joints) + 1 == len(profile.rest_action)


def test_the_hand_frame_is_that_of_all_robots(any_robot: str) -> None:
    """z is along the fingers, y is the opening direction, and the tool keypoints are at the fingers."""
    profile = robot(any_robot)
    head, tail, side = (profile.tool_keypoints[point] for point in ("tool_head", "tool_tail", "tool_side"))
    assert (head - tail)[:2] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert (head - tail)[2] > 0.01
    assert (side - head)[[0, 2]] == pytest.approx([0.0, 0.0], abs=1e-9)
    gripper = kpam.ParallelGripper.of_robot(profile.model, **profile.tool_keypoints)
    narrowest, widest = gripper.stroke
    assert narrowest == pytest.approx(0.0, abs=2e-3)
    assert widest == pytest.approx(profile.gripper.widest, abs=4e-3)
    assert side[1] > widest / 2  # on the finger, not between the fingers
    # The pads reach the fingertips, and the head keypoint is between them.
    middle, (_, length) = gripper.T_hand_grip[:3, 3], gripper.pad
    assert middle[2] - length / 2 < head[2] < middle[2] + length / 2
    assert middle[:2] == pytest.approx([0.0, 0.0], abs=1e-3)


def test_an_episode_begins_with_the_hand_over_the_table(any_robot: str) -> None:
    profile = robot(any_robot)
    q, space = np.array(profile.reset_qpos), STANDARD_REGION
    pose = profile.T_world_base @ profile.model.forward_kinematics(q)
    assert pose[:2, 3] == pytest.approx(space.hand_at_rest, abs=0.015)
    assert pose[2, 2] < -0.99  # points down
    head = pose @ [*profile.tool_keypoints["tool_head"], 1.0]
    assert head[2] > space.hand_low_point


def test_the_hand_reaches_the_table_as_far_as_stated(any_robot: str) -> None:
    """Pointing down, 2 cm above the table, straight ahead and half a radian to each side; not much farther."""
    profile = robot(any_robot)
    down = pointing_down(0.02)
    there = point_to_point("tool_head", "there", 0.002)
    config = kpam.SolverConfig({"constraint_list": [there, down]})

    def is_reached(distance: float, angle: float) -> bool:
        height = 0.02 - profile.base_position[2]
        problem = kpam.KeypointProblem(
            profile.model,
            config,
            np.array(profile.reset_qpos),
            tool_keypoints=profile.tool_keypoints,
            object_keypoints={"there": [distance * np.cos(angle), distance * np.sin(angle), height]},
            T_base_object=np.eye(4),
        )
        return bool(kpam.ik(problem, max_solutions=1))

    assert all(is_reached(profile.reach, angle) for angle in (-0.5, 0.0, 0.5))
    assert not any(is_reached(profile.reach + 0.1, angle) for angle in (-0.5, 0.0, 0.5))


def test_commands_and_targets_of_the_fingers_agree(any_robot: str) -> None:
    gripper = robot(any_robot).gripper
    closed, opened = gripper.range
    assert gripper.target(np.array([OPEN, CLOSED, 3.0], dtype=np.float32)) == pytest.approx(
        [opened, closed, opened], abs=1e-7
    )
    for opening in (gripper.widest, 0.02, 0.0):
        command = np.array([gripper.command(opening)], dtype=np.float32)
        assert gripper.target(command) == pytest.approx([gripper.planned(opening)], abs=1e-6)
        joints = gripper.at_opening(opening)
        assert gripper.opening(joints) == pytest.approx(opening)
        assert gripper.command_at(joints) == pytest.approx(float(command[0]), abs=1e-6)
    assert gripper.opening(gripper.at_command(CLOSED)) == 0.0
    assert gripper.grip(0.02, 2.0, 1e3) < gripper.command(0.02)


def test_profiles_go_to_workers(any_robot: str) -> None:
    profile = robot(any_robot)
    again = pickle.loads(pickle.dumps(profile))
    assert again.urdf == profile.urdf
    assert again.reset_qpos == profile.reset_qpos


def test_an_unknown_robot_is_refused_by_name() -> None:
    with pytest.raises(InputError, match=r"no robot 'r2d2'.*panda") as refused:
        robot("r2d2")
    assert refused.value.field == "robot"


def test_a_urdf_alone_is_no_robot_and_the_error_names_what_reads_it() -> None:
    with pytest.raises(InputError, match=r"'arm/mine.urdf' is a URDF.*files.*gensim2_kpam.Robot.from_urdf"):
        load_robot("arm/mine.urdf")

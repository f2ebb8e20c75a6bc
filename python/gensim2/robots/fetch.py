"""ManiSkill's Fetch robot with base, torso and head fixed."""

from __future__ import annotations

from math import pi

from gensim2.robots.description import stored
from gensim2.robots.fixed_base import fixed_base, never_touching
from gensim2.robots.gripper import SlidingGripper
from gensim2.robots.maniskill import robot_folder
from gensim2.robots.profile import Footprint, JointDrive, RobotFiles, RobotProfile, Simulation, finger_keypoints

TORSO_HEIGHT = 0.38
"""Position of the torso's lift joint, m; its maximum is 0.386. The shoulder is then 0.57 m above the table."""

FINGERTIP = 0.024
"""Distance (m) from ManiSkill's ``gripper_link`` to the point 7 mm behind the finger tips, as for the Panda."""


def fetch_files() -> RobotFiles:
    """Return the files of ManiSkill's Fetch with a fixed base, which are written to the user's cache folder.

    Head and torso are fixed, and a new link is the hand frame. Simulators count the turns of the three continuous
    joints differently. Therefore these joints are limited to half a turn. The hand can still reach every orientation.

    Raises:
        MissingExtraError: ManiSkill is not installed.
        InputError: the cache folder cannot be written to.
    """
    source = robot_folder("fetch")
    urdf = fixed_base(
        source / "fetch.urdf",
        base="base_link",
        standing={"torso_lift_joint": TORSO_HEIGHT, "head_pan_joint": 0.0, "head_tilt_joint": 0.0},
        turns=pi,
        palm="gripper_link",
        hand="fetch_hand",
        pitch=pi / 2,  # The z axis of the hand frame must point along the fingers, like the palm's x axis.
        tool="fetch_hand_tcp",
        tool_at=FINGERTIP,
    )
    srdf = never_touching(source / "fetch.srdf", ("wrist_roll_link", "gripper_link"))
    return stored("fetch", urdf, srdf)


def fetch() -> RobotProfile:
    """Return the profile; drives and friction are those of ManiSkill's agent.

    The robot stands on the floor, 0.6 m below the top of the table. Its wheels are below the table and its torso is at
    the edge.
    """
    return RobotProfile(
        name="fetch",
        files=fetch_files,
        hand_link="fetch_hand",
        tool_link="fetch_hand_tcp",
        arm_joints=(
            "shoulder_pan_joint",
            "shoulder_lift_joint",
            "upperarm_roll_joint",
            "elbow_flex_joint",
            "forearm_roll_joint",
            "wrist_flex_joint",
            "wrist_roll_joint",
        ),
        gripper=SlidingGripper(
            joints=("r_gripper_finger_joint", "l_gripper_finger_joint"),
            fingers=("r_gripper_finger_joint", "l_gripper_finger_joint"),
            pads=("r_gripper_finger_link", "l_gripper_finger_link"),
            open=0.05,
            closed=-0.01,
            travel_seconds=0.7,
            friction=2.0,
        ),
        reset_qpos=(0.0, -1.04, 0.0, 2.04, 0.0, 0.570796, 0.0, 0.05, 0.05),
        base_position=(-0.7, 0.0, -0.6),
        tool_keypoints=finger_keypoints(tip=FINGERTIP, side=0.064),
        reach=0.77,
        simulation=Simulation(
            agent="fetch_fixed_base", arm=JointDrive(1e3, 1e2, 100.0), gripper=JointDrive(1e3, 1e2, 100.0)
        ),
        footprint=Footprint(base_half=0.15, hand_half=0.14, hand_drop=0.02),
        solver={
            "limits": "plain",
            "joint_weights": [10.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0],
            "workspace": [[0.05, -1.0, 0.0], [1.0, 1.0, 1.0]],
        },
    )

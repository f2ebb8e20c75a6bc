"""ManiSkill's xArm7 with a rack gripper: a motor turns a pinion, two racks follow, and the pads have passive hinges."""

from pathlib import Path

import gensim2
from gensim2.robots import (
    Footprint,
    JointDrive,
    Mimic,
    RobotFiles,
    RobotProfile,
    Simulation,
    SlidingGripper,
    finger_keypoints,
    mounted,
    read_description,
    robot_folder,
    stored,
    touching_neighbours,
)

RACKS = ("left_rack_joint", "right_rack_joint")
HINGES = ("left_hinge_joint", "right_hinge_joint")


def files() -> RobotFiles:
    arm = read_description(robot_folder("xarm7") / "xarm7.urdf")
    gripper = read_description(Path(__file__).with_name("rack_gripper.urdf"))
    both = mounted(arm, "link_eef", gripper, "palm")
    close = [("link7", "palm"), ("link6", "palm"), ("link5", "link7"), ("link2", "link4"), ("left_pad", "right_pad")]
    return stored("xarm7", both, touching_neighbours(both, *close, ("left_rack", "right_rack")))


@gensim2.register_robot
def xarm7() -> RobotProfile:
    return RobotProfile(
        name="xarm7",
        files=files,
        hand_link="palm",
        tool_link="tcp",
        arm_joints=tuple(f"joint{number}" for number in range(1, 8)),
        gripper=SlidingGripper(
            joints=("pinion_joint", *RACKS, *HINGES),
            fingers=RACKS,
            pads=("left_pad", "right_pad"),
            open=0.04,
            closed=-0.01,
            travel_seconds=0.7,
            friction=2.0,
            driven=("pinion_joint",),
            mimics=dict.fromkeys(RACKS, Mimic("pinion_joint", 0.02)),
            passive=HINGES,
        ),
        reset_qpos=(0.0, -0.465, 0.0, 0.658, 0.0, 1.191, 0.0, 2.0, 0.04, 0.04, 0.0, 0.0),
        base_position=(-0.54, 0.0, 0.0),
        tool_keypoints=finger_keypoints(tip=0.125, side=0.053),
        reach=0.7,
        footprint=Footprint(base_half=0.1, hand_half=0.12, hand_drop=0.02),
        simulation=Simulation(
            agent="xarm7_rack",
            arm=JointDrive(1e3, 1e2, 100.0),
            gripper=JointDrive(10.0, 0.5, 10.0),
            mimic=JointDrive(1e3, 1e2, 100.0),
            passive=JointDrive(2.0, 0.05, 10.0),
        ),
    )

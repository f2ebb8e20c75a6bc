"""A UR5e with the Panda's hand: ``gensim2 demo OpenDrawer --robot examples/robots/ur5e.py``."""

from pathlib import Path

import numpy as np

import gensim2
from gensim2.robots import (
    Footprint,
    JointDrive,
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

FINGERS = ("panda_finger_joint1", "panda_finger_joint2")


def files() -> RobotFiles:
    arm = read_description(Path(__file__).with_name("ur5e.urdf"))
    hand = read_description(robot_folder("panda") / "panda_v2.urdf")
    both = mounted(arm, "flange", hand, "panda_hand", rpy=(0.0, 0.0, -np.pi / 2))
    close = [("wrist_3_link", "panda_hand"), ("wrist_2_link", "panda_hand"), ("panda_leftfinger", "panda_rightfinger")]
    return stored("ur5e", both, touching_neighbours(both, *close))


@gensim2.register_robot
def ur5e() -> RobotProfile:
    return RobotProfile(
        name="ur5e",
        files=files,
        hand_link="panda_hand",
        tool_link="panda_hand_tcp",
        arm_joints=tuple(
            f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
        ),
        gripper=SlidingGripper(
            joints=FINGERS,
            fingers=FINGERS,
            pads=("panda_leftfinger", "panda_rightfinger"),
            open=0.04,
            closed=-0.01,
            travel_seconds=0.6,
            friction=2.0,
        ),
        reset_qpos=(-0.33, -1.801, 1.961, -1.666, -1.593, -0.329, 0.04, 0.04),
        base_position=(-0.615, 0.0, 0.0),
        tool_keypoints=finger_keypoints(tip=0.105, side=0.053),
        reach=0.85,
        footprint=Footprint(base_half=0.1, hand_half=0.12, hand_drop=0.02),
        simulation=Simulation(
            agent="ur5e_panda_hand", arm=JointDrive(1e3, 1e2, 150.0), gripper=JointDrive(1e3, 1e2, 100.0)
        ),
    )

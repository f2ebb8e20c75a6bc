"""A KUKA LBR iiwa 14 with a wide gripper: one motor moves both jaws, which open by 11 cm.

The folded arm is long, so it cannot reach low objects in front of its base. Therefore it stands on a pedestal.
"""

from pathlib import Path

import numpy as np

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
    stored,
    touching_neighbours,
)

JAWS = ("left_jaw_joint", "right_jaw_joint")


def files() -> RobotFiles:
    arm = read_description(Path(__file__).with_name("iiwa14.urdf"))
    gripper = read_description(Path(__file__).with_name("wide_gripper.urdf"))
    both = mounted(arm, "flange", gripper, "palm", rpy=(0.0, 0.0, np.pi))
    close = [("link_1", "link_3"), ("link_3", "link_5"), ("link_5", "link_7"), ("link_7", "palm"), ("link_6", "palm")]
    return stored("iiwa14", both, touching_neighbours(both, *close, ("left_finger", "right_finger")))


@gensim2.register_robot
def iiwa14() -> RobotProfile:
    return RobotProfile(
        name="iiwa14",
        files=files,
        hand_link="palm",
        tool_link="tcp",
        arm_joints=tuple(f"joint_{number}" for number in range(1, 8)),
        gripper=SlidingGripper(
            joints=JAWS,
            fingers=JAWS,
            pads=("left_finger", "right_finger"),
            open=0.055,
            closed=-0.01,
            travel_seconds=0.7,
            friction=2.0,
            driven=JAWS[:1],
            mimics={JAWS[1]: Mimic(JAWS[0])},
        ),
        reset_qpos=(0.0, 0.8335, 0.0, -1.9648, 0.0, 0.4114, 0.0, 0.055, 0.055),
        base_position=(-0.65, 0.0, 0.0),
        tool_keypoints=finger_keypoints(tip=0.14, side=0.061),
        reach=0.75,
        footprint=Footprint(base_half=0.1, hand_half=0.12, hand_drop=0.02),
        simulation=Simulation(
            agent="iiwa14_wide_gripper", arm=JointDrive(1e3, 1e2, 176.0), gripper=JointDrive(1e3, 1e2, 80.0)
        ),
    )

"""Profile of the Franka Panda with its standard fingers and ManiSkill's drives."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from gensim2.robots.gripper import SlidingGripper
from gensim2.robots.maniskill import robot_folder
from gensim2.robots.profile import Footprint, JointDrive, RobotFiles, RobotProfile, Simulation, finger_keypoints


def panda_files() -> RobotFiles:
    """Return the paths of ManiSkill's Panda, or of this package's copy if ManiSkill is not installed.

    The copy is Franka's ``franka_description`` (Apache-2.0) with ManiSkill's joints, inertias and collision meshes.
    Therefore both behave in the same way. The visual meshes of the copy have no normals.
    """
    if find_spec("mani_skill") is None:
        folder = Path(__file__).parent / "franka_description"
        return RobotFiles(folder / "panda.urdf", folder / "panda.srdf")
    folder = robot_folder("panda")
    return RobotFiles(folder / "panda_v2.urdf", folder / "panda_v2.srdf")


def panda() -> RobotProfile:
    """Return the profile; drives, gripper targets and friction are those of ManiSkill's agent."""
    return RobotProfile(
        name="panda",
        files=panda_files,
        hand_link="panda_hand",
        tool_link="panda_hand_tcp",
        arm_joints=tuple(f"panda_joint{number}" for number in range(1, 8)),
        gripper=SlidingGripper(
            joints=("panda_finger_joint1", "panda_finger_joint2"),
            fingers=("panda_finger_joint1", "panda_finger_joint2"),
            pads=("panda_leftfinger", "panda_rightfinger"),
            open=0.04,
            closed=-0.01,
            travel_seconds=0.6,
            friction=2.0,
        ),
        reset_qpos=(0.0, -0.32, 0.0, -2.61799, 0.0, 2.23, 0.785398, 0.04, 0.04),
        base_position=(-0.615, 0.0, 0.0),
        tool_keypoints=finger_keypoints(tip=0.105, side=0.053),
        reach=0.75,
        simulation=Simulation(
            agent="panda", arm=JointDrive(1e3, 1e2, 100.0), gripper=JointDrive(1e3, 1e2, 100.0), tendons=True
        ),
        footprint=Footprint(base_half=0.12, hand_half=0.12, hand_drop=0.02),
        # Franka has published the limits. The original GenSim2 has the same joint weights and the same workspace.
        solver={
            "limits": "panda",
            "joint_weights": [10.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0],
            "workspace": [[0.05, -1.0, 0.0], [1.0, 1.0, 1.0]],
        },
    )

"""The Franka Panda with its own fingers, as ManiSkill ships it."""

from __future__ import annotations

import numpy as np

from gensim2.robots.maniskill import robot_folder
from gensim2.robots.profile import Gripper, RobotProfile


def panda() -> RobotProfile:
    """The profile; drives, rates and gripper targets are those of ManiSkill's agent.

    Raises:
        MissingExtraError: ManiSkill is not installed.
    """
    folder = robot_folder("panda")
    return RobotProfile(
        name="panda",
        urdf=folder / "panda_v2.urdf",
        srdf=folder / "panda_v2.srdf",
        hand_link="panda_hand",
        arm_joints=tuple(f"panda_joint{number}" for number in range(1, 8)),
        gripper=Gripper(
            joints=("panda_finger_joint1", "panda_finger_joint2"),
            open=0.04,
            closed=-0.01,
            stiffness=1e3,
            damping=1e2,
            force_limit=100.0,
        ),
        reset_qpos=(0.0, -0.32, 0.0, -2.61799, 0.0, 2.23, 0.785398, 0.04, 0.04),
        base_position=(-0.615, 0.0, 0.0),
        tool_keypoints={
            "tool_head": np.array([0.0, 0.0, 0.105]),
            "tool_tail": np.array([0.0, 0.0, 0.075]),
            "tool_side": np.array([0.0, 0.053, 0.105]),
        },
        tool_keypoint_descriptions={
            "tool_head": "the middle point between the two finger tips",
            "tool_tail": "the middle point between the two finger bases",
            "tool_side": "the tip of the right finger",
        },
        reach=0.75,
        stiffness=1e3,
        damping=1e2,
        force_limit=100.0,
    )

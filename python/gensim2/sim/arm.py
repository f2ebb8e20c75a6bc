"""A robot in a scene of SAPIEN's own, driven as ManiSkill's control mode ``pd_joint_pos`` drives its agent."""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt
import sapien
from sapien import physx
from sapien.wrapper.articulation_builder import ArticulationBuilder

from gensim2.errors import InputError
from gensim2.robots import RobotProfile, robot
from gensim2.sim.agents import urdf_config
from gensim2.sim.articulations import built, parsed

Row = npt.NDArray[np.float32]


class Arm:
    """A robot, standing where its profile puts it; its URDF is parsed once a process.

    Args:
        scene: to build into.
        profile: of the robot.

    Attributes:
        articulation: what was built.
        tool: the link whose pose observations give.
    """

    def __init__(self, scene: sapien.Scene, profile: RobotProfile) -> None:
        self.profile = profile
        base = sapien.Pose(p=list(profile.base_position))
        self.articulation: physx.PhysxArticulation = built(_builder(profile.name), scene, base)
        for link in self.articulation.links:
            link.disable_gravity = True  # ManiSkill's stand-in for a controller that balances the arm's weight
        joints = {joint.name: joint for joint in self.articulation.active_joints}
        self._arm = [joints[name] for name in profile.arm_joints]
        self._fingers = [joints[name] for name in profile.gripper.joints]
        for drive, driven in ((profile, self._arm), (profile.gripper, self._fingers)):
            for joint in driven:
                joint.set_drive_properties(drive.stiffness, drive.damping, force_limit=drive.force_limit, mode="force")
                joint.set_friction(0.0)
        self.tool: physx.PhysxArticulationLinkComponent = next(
            link for link in self.articulation.links if link.name == profile.tool_link
        )

    def reset(self) -> None:
        """Put the joints where an episode begins."""
        self.articulation.qpos = np.array(self.profile.reset_qpos, dtype=np.float32)

    def command(self, action: npt.ArrayLike) -> None:
        """Send the targets of one control step.

        Args:
            action: (m + 1,): targets of the arm joints, and the gripper from -1 (closed) to 1 (open).

        Raises:
            InputError: it has the wrong shape or is not finite.
        """
        size = self.profile.arm_size
        values: Row = np.asarray(action, dtype=np.float32)
        if values.shape != (size + 1,) or not np.isfinite(values).all():
            raise InputError(f"must be {size + 1} finite numbers", field="action")
        for index, joint in enumerate(self._arm):
            joint.drive_target = values[index : index + 1]
        target = self.profile.gripper.target(values[size:])
        for finger in self._fingers:
            finger.drive_target = target


@cache
def _builder(name: str) -> ArticulationBuilder:
    profile = robot(name)
    return parsed(str(profile.urdf), urdf_config(profile))

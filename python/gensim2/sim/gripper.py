"""Drive a gripper's follower joints and passive joints in a simulated scene."""

from __future__ import annotations

import numpy as np
from sapien import physx

from gensim2.core.errors import InputError
from gensim2.robots import JointDrive, RobotProfile


class Transmission:
    """Object that moves the gripper joints that have no motor: follower joints and passive joints.

    The transmission couples a follower joint to the joint of a motor: before every physics step it sets the target of
    the follower's drive from the motor's joint. PhysX's tendons add radians to metres, so they cannot couple revolute
    with prismatic joints. Springs pull passive joints to 0.

    Args:
        robot: robot in the simulation.
        profile: profile of the robot.
    """

    def __init__(self, robot: physx.PhysxArticulation, profile: RobotProfile) -> None:
        gripper, simulation = profile.gripper, profile.simulation
        self._robot = robot
        joints = robot_joints(robot, profile)
        columns = {name: index for index, name in enumerate(joints)}
        self._follow = []
        for name, mimic in gripper.mimics.items():
            _drive(joints[name], simulation.mimic)
            self._follow.append((joints[name], columns[mimic.joint], mimic.multiplier, mimic.offset))
        for name in gripper.passive:
            _drive(joints[name], simulation.passive)

    def before_substep(self) -> None:
        """Compute the follower joints' targets from the positions of the driven joints."""
        if not self._follow:
            return
        q = self._robot.qpos
        for joint, source, multiplier, offset in self._follow:
            joint.drive_target = np.array([multiplier * q[source] + offset], dtype=np.float32)


def robot_joints(robot: physx.PhysxArticulation, profile: RobotProfile) -> dict[str, physx.PhysxArticulationJoint]:
    """Return the active joints by their names in the URDF, in the profile's order.

    Raises:
        InputError: the physics engine orders the joints differently from the profile.
    """
    names, built = (*profile.arm_joints, *profile.gripper.joints), robot.active_joints
    # Compare only the ends of the names, because ManiSkill prefixes the names of scene and robot.
    if len(names) != len(built) or not all(joint.name.endswith(name) for name, joint in zip(names, built, strict=True)):
        raise InputError(
            f"the profile's joints must be in SAPIEN's order, which is {', '.join(joint.name for joint in built)}",
            file=profile.urdf,
            field="arm_joints",
            remedy="in the profile and the URDF, list joints nearer to the base before joints farther from it",
        )
    return dict(zip(names, built, strict=True))


def _drive(joint: physx.PhysxArticulationJoint, drive: JointDrive) -> None:
    joint.set_drive_properties(drive.stiffness, drive.damping, force_limit=drive.force_limit, mode="force")
    joint.set_drive_target(0.0)
    joint.set_friction(0.0)

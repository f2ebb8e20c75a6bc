"""Build the robot of the headless environment and drive it as ManiSkill's ``pd_joint_pos`` does."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import sapien
from mani_skill.utils import sapien_utils
from sapien import physx
from sapien.wrapper.articulation_builder import ArticulationBuilder
from sapien.wrapper.urdf_loader import URDFLoader

from gensim2.robots import RobotProfile
from gensim2.sim.agents import urdf_config
from gensim2.sim.engines import checked_command
from gensim2.sim.gripper import Transmission, robot_joints
from gensim2.sim.physics import Physics
from gensim2.sim.sapien_parts import SapienRobot


class Arm:
    """A robot that is built in a SAPIEN scene.

    Args:
        scene: scene to which the robot is added, in the start configuration of its profile.
        physics: physics of the scene.
    """

    def __init__(self, scene: sapien.Scene, profile: RobotProfile, physics: Physics) -> None:
        self._profile = profile
        self.articulation = built(
            _builder(profile, physics.name), scene, base_pose(profile), tendons=profile.simulation.tendons
        )
        for link in self.articulation.links:
            # Like ManiSkill, switch off gravity for the robot's links instead of compensating it.
            link.disable_gravity = True
        joints = robot_joints(self.articulation, profile)
        self._arm = [joints[name] for name in profile.arm_joints]
        self._motors = [joints[name] for name in profile.gripper.driven]
        motors = [profile.simulation.gripper] * len(self._motors)
        for joint, gains in zip([*self._arm, *self._motors], [*profile.arm_drives, *motors], strict=True):
            joint.set_drive_properties(gains.stiffness, gains.damping, force_limit=gains.force_limit, mode="force")
            joint.set_friction(0.0)
        self.transmission = Transmission(self.articulation, profile)
        physics.prepare_robot(self.articulation, profile)
        self.reader = SapienRobot(profile, self.articulation)

    def put(self, start: Sequence[float]) -> None:
        self.articulation.qpos = np.array(start, dtype=np.float32)

    def drive(self, action: npt.ArrayLike) -> None:
        """Set the targets of the drives.

        Raises:
            InputError: the action has the wrong shape or is not finite.
        """
        size = len(self._arm)
        command = checked_command(action, size + 1)
        for index, joint in enumerate(self._arm):
            joint.drive_target = command[index : index + 1]
        target = self._profile.gripper.target(command[size:])
        for joint in self._motors:
            joint.drive_target = target


def parsed(
    urdf: str, config: Mapping[str, Any] | None = None, prepare: Callable[[URDFLoader], None] | None = None
) -> ArticulationBuilder:
    """Parse a URDF file, and return a builder of the articulation. The builder omits visual shapes.

    Args:
        config: contact materials of links, and the radii of their contact patches, in ManiSkill's format.
        prepare: function that is called with the loader before the loader reads the file.
    """
    loader = URDFLoader()
    # The loader needs a scene to create builders; the builder can later build into any scene.
    loader.set_scene(sapien.Scene([physx.PhysxCpuSystem()]))
    loader.fix_root_link = True
    if config is not None:
        sapien_utils.apply_urdf_config(loader, sapien_utils.parse_urdf_config(config))
    loader._build_link = _without_visuals(loader._build_link)
    if prepare is not None:
        prepare(loader)
    articulations, _, _ = loader.parse(urdf)
    builder: ArticulationBuilder = articulations[0]
    return builder


def built(
    builder: ArticulationBuilder, scene: sapien.Scene, pose: sapien.Pose, *, tendons: bool = True
) -> physx.PhysxArticulation:
    """Build an articulation in a scene with its root at ``pose``.

    Args:
        tendons: whether PhysX couples mimic joints.
    """
    builder.set_scene(scene)
    builder.set_initial_pose(pose)
    articulation: physx.PhysxArticulation = builder.build(build_mimic_joints=tendons)
    articulation.pose = pose
    return articulation


def _without_visuals(build_link: Callable[[Any, Any], None]) -> Callable[[Any, Any], None]:
    def build(link: Any, builder: Any) -> None:
        link.visuals = []
        build_link(link, builder)

    return build


def base_pose(profile: RobotProfile) -> sapien.Pose:
    return sapien.Pose(p=list(profile.base_position), q=list(profile.base_quaternion))


def _builder(profile: RobotProfile, name: str) -> ArticulationBuilder:
    return _parsed(str(profile.urdf), profile.gripper.friction, profile.gripper.pads, name)


@cache
def _parsed(urdf: str, friction: float, pads: tuple[str, ...], name: str) -> ArticulationBuilder:
    """Return a robot's URDF builder, cached by the physics settings ``name``, whose material it stores."""
    return parsed(urdf, urdf_config(friction, pads))

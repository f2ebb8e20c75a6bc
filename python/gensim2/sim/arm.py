"""Robot of the headless environment: built from its profile, driven as its controller ``pd_joint_pos`` drives it."""

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

from gensim2.errors import InputError
from gensim2.robots import RobotProfile, robot
from gensim2.scenes.physics import PhysicsName
from gensim2.sim.agents import urdf_config
from gensim2.sim.objects import link_name
from gensim2.sim.parts import Row, articulation_state, pose_row
from gensim2.sim.physics import Physics
from gensim2.sim.scene_state import RobotReader


class Arm:
    """A robot in a scene of SAPIEN.

    Args:
        scene: where it is built; it stands at the profile's start.
        profile: of the robot.
        physics: of the scene.
    """

    def __init__(self, scene: sapien.Scene, profile: RobotProfile, physics: Physics) -> None:
        self._profile = profile
        self.articulation = built(
            _builder(profile.name, physics.name), scene, sapien.Pose(p=list(profile.base_position))
        )
        for link in self.articulation.links:
            link.disable_gravity = True  # ManiSkill's stand-in for a controller that balances the arm's weight
        joints = {joint.name: joint for joint in self.articulation.active_joints}
        self._arm = [joints[name] for name in profile.arm_joints]
        self._fingers = [joints[name] for name in profile.gripper.joints]
        for drives, gains in ((self._arm, profile), (self._fingers, profile.gripper)):
            for joint in drives:
                joint.set_drive_properties(gains.stiffness, gains.damping, force_limit=gains.force_limit, mode="force")
                joint.set_friction(0.0)
        physics.prepare_robot(self.articulation, profile.gripper)
        self._tool = next(link for link in self.articulation.links if link_name(link) == profile.tool_link)
        self.reader = RobotReader(profile, self.articulation)

    @property
    def command_size(self) -> int:
        """Numbers of an action."""
        return len(self._arm) + 1

    def put(self, start: Sequence[float]) -> None:
        """Stand where an episode starts: (n,) all active joints, rad and m."""
        self.articulation.qpos = np.array(start, dtype=np.float32)

    def drive(self, action: npt.ArrayLike) -> None:
        """Set the drives' targets.

        Raises:
            InputError: the action has the wrong shape or is not finite.
        """
        command = np.asarray(action, dtype=np.float32)
        size = len(self._arm)
        if command.shape != (size + 1,) or not np.isfinite(command).all():
            raise InputError(f"must be {size + 1} finite numbers", field="action")
        for index, joint in enumerate(self._arm):
            joint.drive_target = command[index : index + 1]
        target = self._profile.gripper.target(command[size:])
        for joint in self._fingers:
            joint.drive_target = target

    def state(self) -> Row:
        """(13 + 2 n,) ManiSkill's: root pose, root velocities, qpos, qvel."""
        return articulation_state(self.articulation)

    def observed(self) -> list[Row]:
        """What observations begin with: qpos, qvel, pose of the tool in the world (7,)."""
        return [self.articulation.qpos, self.articulation.qvel, pose_row(self._tool.entity)]


def parsed(
    urdf: str, config: Mapping[str, Any] | None = None, prepare: Callable[[URDFLoader], None] | None = None
) -> ArticulationBuilder:
    """A builder for a URDF, without its visuals.

    Args:
        urdf: path of the file.
        config: ManiSkill's: materials and patch radii of links.
        prepare: is given the loader before it reads.
    """
    loader = URDFLoader()
    # The loader wants a scene for its builders only; a parsed builder builds into any.
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


def built(builder: ArticulationBuilder, scene: sapien.Scene, pose: sapien.Pose) -> physx.PhysxArticulation:
    """What a builder makes in a scene, its root at ``pose``."""
    builder.set_scene(scene)
    builder.set_initial_pose(pose)
    articulation: physx.PhysxArticulation = builder.build()
    articulation.pose = pose
    return articulation


def _without_visuals(build_link: Callable[[Any, Any], None]) -> Callable[[Any, Any], None]:
    def build(link: Any, builder: Any) -> None:
        link.visuals = []
        build_link(link, builder)

    return build


@cache
def _builder(name: str, physics: PhysicsName) -> ArticulationBuilder:
    """One for each physics: builders keep the default material that there was when they were parsed."""
    profile = robot(name)
    return parsed(str(profile.urdf), urdf_config(profile))

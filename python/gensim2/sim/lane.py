"""Episodes that nobody watches: the scene of :class:`~gensim2.sim.env.GenSim2Env`, without ManiSkill around each step.

Same bodies in the same order, same drives, same numbers: for the same actions the states are those of the registered
environment, bit for bit. What is left out is what a search or a collection never looks at: tensors of one row, rewards,
observations that nobody asked for, and the parsing of the robot's URDF at every reset.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import sapien
from mani_skill.agents.robots.panda.panda import Panda
from mani_skill.utils import sapien_utils
from sapien import physx
from sapien.wrapper.articulation_builder import ArticulationBuilder
from sapien.wrapper.urdf_loader import URDFLoader

from gensim2.errors import GenSim2Error, InputError
from gensim2.objects.types import Instance
from gensim2.planning.scene import Scene
from gensim2.seeding import check_seed
from gensim2.sim.arguments import ObjectSource, as_library, as_task, chosen_instances
from gensim2.sim.objects import apply_friction, check_object, link_name
from gensim2.sim.physics import CONTROL_HZ, PHYSICS_HZ, new_system
from gensim2.sim.randomize import RESET_OPTIONS, check_options
from gensim2.sim.robot import BASE_POSITION, RESET_QPOS
from gensim2.sim.scene_state import read_scene
from gensim2.sim.setup import SceneSetup, set_up
from gensim2.sim.table import build_table
from gensim2.tasks.criteria import succeeded
from gensim2.tasks.spec import TaskSpec

Row = npt.NDArray[np.float32]

ARM_JOINTS = 7
_FINGER_LOW, _FINGER_HIGH = np.float32(-0.01), np.float32(0.04)  # ManiSkill's targets (m) of gripper commands -1 and 1
_TOOL_LINK = "panda_hand_tcp"


class Lane:
    """One task's episodes in physics alone; actions are those of the control mode ``pd_joint_pos``.

    Args:
        task: name of a library task, a :class:`TaskSpec`, or its fields.
        assets: as in :func:`gensim2.objects.open_library`, or an opened library.
        instances: ``"all"``, ``"train"``, ``"test"``, one id, or several; a reset draws one.

    Raises:
        InputError: an argument is wrong.
    """

    control_mode = "pd_joint_pos"

    def __init__(
        self,
        task: str | TaskSpec | Mapping[str, Any],
        *,
        assets: str | Path | ObjectSource | None = None,
        instances: str | Sequence[str] = "all",
    ) -> None:
        self.task = as_task(task)
        self._library = as_library(assets)
        self.instance_ids = chosen_instances(self._library, self.task, instances)
        self._setup: SceneSetup | None = None
        self._robot: physx.PhysxArticulation | None = None
        self.seed = 0
        self.elapsed_steps = 0
        self.reset_options: dict[str, Any] = {}

    @property
    def max_episode_steps(self) -> int:
        """Control steps after which an episode is truncated."""
        return self.task.max_episode_steps

    # ------------------------------------------------------------------ scene

    def reset(self, seed: int, options: Mapping[str, Any] | None = None, *, robot: bool = True) -> None:
        """Build a fresh scene.

        Args:
            seed: 0 to 2**32 - 1.
            options: as in :class:`~gensim2.sim.env.GenSim2Env`.
            robot: leave the arm out where False, to see what the object does by itself.

        Raises:
            InputError: a seed or an option cannot be used, or the object's files.
        """
        check_options(options)
        self.seed = check_seed(seed)
        self.reset_options = {name: value for name, value in (options or {}).items() if name in RESET_OPTIONS}
        setup = set_up(self.task, self._library, self.instance_ids, self.seed, self.reset_options)
        self._system = new_system()
        scene = self._scene = sapien.Scene([self._system])  # kept: what stands in it goes with it
        # In the environment's order: PhysX solves contacts in the order in which bodies came.
        self._robot = _build_robot(scene) if robot else None
        build_table(scene, visible=False)
        self._object, self.object_warnings = _build_object(scene, setup)
        self._setup, self.elapsed_steps = setup, 0
        if self._robot is not None:
            self._robot.qpos = np.array(RESET_QPOS, dtype=np.float32)
            self._drives = self._robot.active_joints
        self._object.qpos = np.array([setup.joint_value], dtype=np.float32)

    @property
    def instance(self) -> Instance:
        """The object that stands on the table."""
        return self._require_setup().instance

    def _require_setup(self) -> SceneSetup:
        if self._setup is None:
            raise GenSim2Error("the environment has not been reset yet")
        return self._setup

    def _require_robot(self) -> physx.PhysxArticulation:
        self._require_setup()
        if self._robot is None:
            raise GenSim2Error("the scene was built without the robot")
        return self._robot

    # ------------------------------------------------------------------- time

    def step(self, action: npt.ArrayLike) -> None:
        """One control step (0.05 s).

        Args:
            action: (8,): 7 arm joint targets in rad, and the gripper from -1 (closed) to 1 (open).

        Raises:
            InputError: the action has the wrong shape or is not finite.
        """
        self._require_robot()
        command = np.asarray(action, dtype=np.float32)
        if command.shape != (ARM_JOINTS + 1,) or not np.isfinite(command).all():
            raise InputError(f"must be {ARM_JOINTS + 1} finite numbers", field="action")
        for index in range(ARM_JOINTS):
            self._drives[index].drive_target = command[index : index + 1]
        half = np.float32(0.5)
        grip = np.clip(command[ARM_JOINTS:], np.float32(-1.0), np.float32(1.0))
        target = half * (_FINGER_HIGH + _FINGER_LOW) + half * (_FINGER_HIGH - _FINGER_LOW) * grip
        for finger in self._drives[ARM_JOINTS:]:
            finger.drive_target = target
        self._advance()

    def wait(self) -> None:
        """One control step in which nothing is commanded."""
        self._require_setup()
        self._advance()

    def _advance(self) -> None:
        instance = self.instance
        for _ in range(PHYSICS_HZ // CONTROL_HZ):
            if instance.joint.damping > 0:
                apply_friction(self._object, instance, float(self._object.qvel[0]))
            self._system.step()
        self.elapsed_steps += 1

    # ------------------------------------------------------------ measurement

    @property
    def openness(self) -> float:
        """(q - lower) / (upper - lower) of the object's joint; may leave 0..1 by the joint's give."""
        joint = self.instance.joint
        return (float(self._object.qpos[0]) - joint.lower) / (joint.upper - joint.lower)

    @property
    def success(self) -> bool:
        """Whether every criterion of the task holds now."""
        return succeeded(self.task, self.openness)

    @property
    def is_finite(self) -> bool:
        """Whether physics still gives numbers for the robot and the object's root."""
        robot = [] if self._robot is None else [self._robot.qpos]
        return all(np.isfinite(row).all() for row in (*robot, _pose(self._object.root)))

    def scene_state(self) -> Scene:
        """The scene as the planner sees it, in the robot base frame; geometry only."""
        return read_scene(self._require_robot(), self._object, self.instance, self._require_setup().yaw)

    def state(self) -> dict[str, dict[str, Row]]:
        """ManiSkill's ``env_states`` of this instant: (13 + 2 n,) root pose, root velocities, qpos and qvel of each."""
        parts = {"panda": self._require_robot(), "object": self._object}
        return {"actors": {}, "articulations": {name: _articulation_state(part) for name, part in parts.items()}}

    def observation(self) -> Row:
        """(D,) the environment's state observation of this instant."""
        robot, instance = self._require_robot(), self.instance
        links = {link_name(link): link for link in (*robot.links, *self._object.links)}
        return np.concatenate(
            [
                robot.qpos,
                robot.qvel,
                _pose(links[_TOOL_LINK]),
                np.array([self.openness], dtype=np.float32),
                self._object.qpos,
                _pose(self._object.root),
                _pose(links[instance.joint.child_link]),
            ]
        ).astype(np.float32)


def _pose(link: physx.PhysxArticulationLinkComponent) -> Row:
    pose = link.entity.pose
    return np.concatenate([pose.p, pose.q])


def _articulation_state(articulation: physx.PhysxArticulation) -> Row:
    root = articulation.root
    velocity = [root.linear_velocity, root.angular_velocity]
    return np.concatenate([_pose(root), *velocity, articulation.qpos, articulation.qvel]).astype(np.float32)


def _parsed(urdf: str, config: Mapping[str, Any] | None = None) -> ArticulationBuilder:
    loader = URDFLoader()
    # The loader wants a scene for its builders only; a parsed builder builds into any.
    loader.set_scene(sapien.Scene([physx.PhysxCpuSystem()]))
    loader.fix_root_link = True
    if config is not None:
        sapien_utils.apply_urdf_config(loader, sapien_utils.parse_urdf_config(config))
    build_link = loader._build_link

    def without_visuals(link: Any, builder: Any) -> None:
        link.visuals = []
        build_link(link, builder)

    loader._build_link = without_visuals
    articulations, _, _ = loader.parse(urdf)
    builder: ArticulationBuilder = articulations[0]
    return builder


@lru_cache(maxsize=1)
def _robot_builder() -> ArticulationBuilder:
    return _parsed(Panda.urdf_path, Panda.urdf_config)


def _built(builder: ArticulationBuilder, scene: sapien.Scene, pose: sapien.Pose) -> physx.PhysxArticulation:
    builder.set_scene(scene)
    builder.set_initial_pose(pose)
    articulation: physx.PhysxArticulation = builder.build()
    articulation.pose = pose
    return articulation


def _build_robot(scene: sapien.Scene) -> physx.PhysxArticulation:
    robot = _built(_robot_builder(), scene, sapien.Pose(p=list(BASE_POSITION)))
    for link in robot.links:
        link.disable_gravity = True  # ManiSkill's stand-in for a controller that balances the arm's weight
    for index, joint in enumerate(robot.active_joints):
        arm = index < ARM_JOINTS
        stiffness, damping, force = (
            (Panda.arm_stiffness, Panda.arm_damping, Panda.arm_force_limit)
            if arm
            else (Panda.gripper_stiffness, Panda.gripper_damping, Panda.gripper_force_limit)
        )
        joint.set_drive_properties(stiffness, damping, force_limit=force, mode="force")
        joint.set_friction(0.0)
    return robot


def _build_object(scene: sapien.Scene, setup: SceneSetup) -> tuple[physx.PhysxArticulation, tuple[str, ...]]:
    built = _built(_parsed(str(setup.instance.urdf)), scene, sapien.Pose(setup.position, setup.quaternion))
    warnings = check_object(built, setup.instance)
    apply_friction(built, setup.instance)
    return built, warnings

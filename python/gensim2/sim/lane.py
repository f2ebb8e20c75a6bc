"""Episodes that nobody watches: the scene of :class:`~gensim2.sim.env.GenSim2Env`, without ManiSkill around each step.

Same bodies in the same order, same drives, same numbers: for the same actions the states are those of the registered
environment, bit for bit. What is left out is what a search or a collection never looks at: tensors of one row, rewards,
observations that nobody asked for, and the parsing of the robot's URDF at every reset.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import sapien
from sapien import physx

from gensim2.errors import GenSim2Error
from gensim2.objects.types import Instance
from gensim2.planning.scene import Scene
from gensim2.robots import DEFAULT
from gensim2.robots import robot as robot_profile
from gensim2.seeding import check_seed
from gensim2.sim.arguments import ObjectSource, as_library, as_task, chosen_instances
from gensim2.sim.arm import Arm
from gensim2.sim.articulations import built, parsed
from gensim2.sim.objects import apply_friction, check_object, link_name
from gensim2.sim.physics import new_system
from gensim2.sim.randomize import RESET_OPTIONS, check_options
from gensim2.sim.scene_state import read_scene
from gensim2.sim.setup import SceneSetup, set_up
from gensim2.sim.table import build_table
from gensim2.tasks.criteria import succeeded
from gensim2.tasks.spec import TaskSpec

Row = npt.NDArray[np.float32]


class Lane:
    """One task's episodes in physics alone; actions are those of the control mode ``pd_joint_pos``.

    Args:
        task: name of a library task, a :class:`TaskSpec`, or its fields.
        assets: as in :func:`gensim2.objects.open_library`, or an opened library.
        instances: ``"all"``, ``"train"``, ``"test"``, one id, or several; a reset draws one.
        robot: name of its profile.

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
        robot: str = DEFAULT,
    ) -> None:
        self.robot = robot_profile(robot)
        self.task = as_task(task)
        self._library = as_library(assets)
        self.instance_ids = chosen_instances(self._library, self.task, instances)
        self._setup: SceneSetup | None = None
        self._arm: Arm | None = None
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
        self._system = new_system(self.robot)
        scene = self._scene = sapien.Scene([self._system])  # kept: what stands in it goes with it
        # In the environment's order: PhysX solves contacts in the order in which bodies came.
        self._arm = Arm(scene, self.robot) if robot else None
        build_table(scene, visible=False)
        self._object, self.object_warnings = _build_object(scene, setup)
        self._setup, self.elapsed_steps = setup, 0
        if self._arm is not None:
            self._arm.reset()
        self._object.qpos = np.array([setup.joint_value], dtype=np.float32)

    @property
    def instance(self) -> Instance:
        """The object that stands on the table."""
        return self._require_setup().instance

    def _require_setup(self) -> SceneSetup:
        if self._setup is None:
            raise GenSim2Error("the environment has not been reset yet")
        return self._setup

    def _require_arm(self) -> Arm:
        self._require_setup()
        if self._arm is None:
            raise GenSim2Error("the scene was built without the robot")
        return self._arm

    # ------------------------------------------------------------------- time

    def step(self, action: npt.ArrayLike) -> None:
        """One control step (0.05 s).

        Args:
            action: (m + 1,): targets of the arm joints, and the gripper from -1 (closed) to 1 (open).

        Raises:
            InputError: the action has the wrong shape or is not finite.
        """
        self._require_arm().command(action)
        self._advance()

    def wait(self) -> None:
        """One control step in which nothing is commanded."""
        self._require_setup()
        self._advance()

    def _advance(self) -> None:
        instance = self.instance
        for _ in range(self.robot.physics_hz // self.robot.control_hz):
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
        robot = [] if self._arm is None else [self._arm.articulation.qpos]
        return all(np.isfinite(row).all() for row in (*robot, _pose(self._object.root)))

    def scene_state(self) -> Scene:
        """The scene as the planner sees it, in the robot base frame; geometry only."""
        return read_scene(
            self._require_arm().articulation, self.robot, self._object, self.instance, self._require_setup().yaw
        )

    def state(self) -> dict[str, dict[str, Row]]:
        """ManiSkill's ``env_states`` of this instant: (13 + 2 n,) root pose, root velocities, qpos and qvel of each."""
        parts = {self.robot.agent: self._require_arm().articulation, "object": self._object}
        return {"actors": {}, "articulations": {name: _articulation_state(part) for name, part in parts.items()}}

    def observation(self) -> Row:
        """(D,) the environment's state observation of this instant."""
        arm, instance = self._require_arm(), self.instance
        links = {link_name(link): link for link in self._object.links}
        return np.concatenate(
            [
                arm.articulation.qpos,
                arm.articulation.qvel,
                _pose(arm.tool),
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


def _build_object(scene: sapien.Scene, setup: SceneSetup) -> tuple[physx.PhysxArticulation, tuple[str, ...]]:
    made = built(parsed(str(setup.instance.urdf)), scene, sapien.Pose(setup.position, setup.quaternion))
    warnings = check_object(made, setup.instance)
    apply_friction(made, setup.instance)
    return made, warnings

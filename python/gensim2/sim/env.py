"""Define the ManiSkill environment of a task: a robot at a table with objects."""

from __future__ import annotations

import dataclasses
import gc
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
import sapien
import torch
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.seeding import np_random
from mani_skill.envs.scene import ManiSkillScene
from mani_skill.sensors.camera import CameraConfig
from mani_skill.utils.structs.types import SimConfig

from gensim2.core.errors import ClosedEnvError, GenSim2Error, InputError
from gensim2.core.seeding import check_seed
from gensim2.objects import RigidObject
from gensim2.perception import ObservationSpec
from gensim2.planning.scene import Scene
from gensim2.scenes.arguments import check_words
from gensim2.scenes.config import SceneConfig, split_arguments
from gensim2.scenes.initial_state import PlacedObject
from gensim2.scenes.reset_options import RESET_OPTIONS, read_options
from gensim2.scenes.sampler import SceneSampler
from gensim2.sim import agents, rendering
from gensim2.sim.arm import base_pose
from gensim2.sim.driver import NO_DRIVER, can_render
from gensim2.sim.gripper import Transmission
from gensim2.sim.objects import load_object
from gensim2.sim.observed import RAYCAST, RaycastObservations
from gensim2.sim.physics import Physics, named_physics, vary
from gensim2.sim.registration import MODULE, recordable
from gensim2.sim.rigid import build_table, load_rigid
from gensim2.sim.sapien_parts import SapienArticulatedPart, SapienPart, SapienRigidPart, SapienRobot
from gensim2.sim.scene_state import read_scene
from gensim2.tasks.criteria import all_hold
from gensim2.tasks.reward import StagedReward
from gensim2.tasks.spec import TaskSpec


def build_part(scene: ManiSkillScene, name: str, thing: PlacedObject, physics: Physics) -> SapienPart:
    """Build an object at its initial pose.

    Raises:
        InputError: the engine built collision shapes or a joint that differ from the object's files.
    """
    pose = sapien.Pose(thing.position, thing.quaternion)
    if isinstance(thing.model, RigidObject):
        part = SapienRigidPart(name, thing, load_rigid(scene, thing.model, pose, name, physics)._objs[0])
        vary([part.body], thing.factors)
        return part
    built, warnings = load_object(scene, thing.model, pose, name, physics)
    articulation = built._objs[0]
    vary(articulation.links, thing.factors)
    resistance = physics.resist(articulation, thing.model, thing.factors)
    return SapienArticulatedPart(name, thing, articulation, resistance, warnings)


@cache
def spare_imports_from_collection() -> None:
    """Exempt all existing Python objects, such as imported modules, from garbage collection, once in each process.

    ManiSkill collects garbage at every reset. The exemption shortens this from 180 ms to 2 ms.
    """
    gc.collect()
    gc.freeze()


class GenSim2Env(RaycastObservations):
    """ManiSkill environment in which a robot stands at a table with the objects of a task.

    Physics and control run on the CPU at the robot's rates. By default PhysX uses the TGS solver and persistent
    manifolds, with 15 position iterations and 1 velocity iteration. Every reset rebuilds the scene. Therefore a seed
    always gives the same scene, and the same actions give the same states, in any process, with or without images.

    An action of the default control mode ``pd_joint_pos`` is an array (m + 1,). It contains the targets of the m arm
    joints in rad (the Panda has 7), and then the gripper command from -1 (closed) to 1 (open).

    Args:
        task: library task, :class:`TaskSpec`, its fields, or a :class:`~gensim2.scenes.config.SceneConfig`.
        obs_mode: a mode of ManiSkill, or ``"raycast"``, which needs no renderer and gives the arrays of an
            :class:`~gensim2.perception.Observation` by name (docs/guides/observations.md).
        observation: an :class:`~gensim2.perception.ObservationSpec` or its fields, for the mode ``"raycast"``.
        reward_mode: ``"sparse"`` (default): 1 at the goal, else 0. ``"normalized_dense"``: 0 to 1, rising with each
            completed step; evaluate it exactly once in each control step, because the evaluation records completed
            steps. ``"none"``: no reward.
        render_backend: ``"auto"`` starts a renderer only if observations or ``render_mode`` need one and a driver
            works.
        kwargs: arguments of :class:`~gensim2.scenes.config.SceneArguments` and of ManiSkill's ``BaseEnv``;
            ``robot_uids`` follows from ``robot``. A reset chooses from ``instances``: an id is for the first object
            whose class has several instances, and a mapping is for named objects. Numbers up to 10^6 select generated
            objects.

    Reset options replace random values: ``instance`` (id), ``openness`` (0 to 1), ``offset`` (x, y, yaw from the
    default pose) and ``pose`` (root in the world: x, y, z, qw, qx, qy, qz). If the task has several objects, each value
    is a mapping from object names.

    Raises:
        InputError: an argument or a reset option is invalid.
    """

    metadata: dict[str, Any]
    _robot: SapienRobot
    _parts: Mapping[str, SapienPart]
    SUPPORTED_REWARD_MODES = ("sparse", "normalized_dense", "none")

    def __init__(
        self,
        task: str | TaskSpec | Mapping[str, Any] | SceneConfig,
        *,
        robot_uids: str | None = None,
        control_mode: str | None = "pd_joint_pos",
        num_envs: int = 1,
        sim_backend: str = "physx_cpu",
        render_backend: str = "auto",
        reconfiguration_freq: int | None = None,
        obs_mode: str | None = None,
        observation: ObservationSpec | Mapping[str, Any] | None = None,
        render_mode: str | None = None,
        reward_mode: str | None = None,
        **kwargs: Any,
    ) -> None:
        if num_envs != 1:
            remedy = "gensim2.make_vec_env makes several, each in a process of its own"
            raise InputError(f"must be 1, but is {num_envs!r}", field="num_envs", remedy=remedy)
        if sim_backend not in ("cpu", "physx_cpu", "auto"):
            raise InputError(f"must be physx_cpu, but is {sim_backend!r}", field="sim_backend")
        if reconfiguration_freq not in (None, 1):
            wrong = "must be 1, because an episode is reproducible only in a newly built scene"
            raise InputError(wrong, field="reconfiguration_freq")
        check_one_of(render_mode, self.metadata["render_modes"], "render_mode")
        check_one_of(reward_mode, self.SUPPORTED_REWARD_MODES, "reward_mode")
        check_words(obs_mode=obs_mode, control_mode=control_mode, render_backend=render_backend)
        scene, rest = split_arguments(kwargs)
        self._sampler = sampler = SceneSampler(task, **scene)
        self.task, self.profile, self.randomization = sampler.task, sampler.profile, sampler.randomization
        if sampler.engine != "sapien":
            remedy = "use gensim2.HeadlessEnv, or leave engine out"
            said = f"the registered environments need the engine sapien, not {sampler.engine}"
            raise InputError(said, field="engine", remedy=remedy)
        self.physics = named_physics(sampler.physics)
        self.metadata = {**self.metadata, "render_fps": self.profile.control_hz}
        if robot_uids not in (None, self.profile.agent):
            said = f"must be {self.profile.agent!r}, the agent of the environment's robot, not {robot_uids!r}"
            raise InputError(said, field="robot_uids", remedy="select the robot with the argument robot")
        agents.register(self.profile)
        self._spec: EnvSpec | None = None
        self._seen = ObservationSpec.of(observation) if obs_mode == RAYCAST else None
        if observation is not None and self._seen is None:
            raise InputError(f"is used only with obs_mode={RAYCAST!r}", field="observation")
        if self._seen is not None and "rgb" in self._seen.modalities:
            raise InputError("rgb requires the renderer", field="observation.modalities", remedy="use obs_mode='rgb'")
        self.reset_options: dict[str, Any] = {}
        self._closed = False
        spare_imports_from_collection()
        try:
            super().__init__(
                num_envs=1,
                robot_uids=self.profile.agent,
                control_mode=control_mode,
                sim_backend="physx_cpu",
                render_backend=rendering.backend(render_backend, "none" if self._seen else obs_mode, render_mode),
                reconfiguration_freq=1,
                # In the mode ``raycast`` this class computes the observations instead of ManiSkill.
                obs_mode=obs_mode if self._seen is None else "none",
                render_mode=render_mode,
                reward_mode=reward_mode,
                **rest,
            )
        except (AssertionError, NotImplementedError) as error:  # raised by ManiSkill for an unknown argument
            check_obs_mode(obs_mode, error)
            raise InputError(f"ManiSkill refuses an argument: {error}", remedy="see ManiSkill's BaseEnv") from error
        except RuntimeError as error:
            if "failed to find device" not in str(error):
                raise
            raise InputError(f"{error}", field="render_backend", remedy="use 'auto' or 'none'") from error

    @property
    def max_episode_steps(self) -> int:
        """Maximum number of control steps of an episode."""
        return self.profile.steps(self.task.max_seconds)

    @property
    def instance_ids(self) -> Mapping[str, tuple[str, ...]]:
        """Ids from which a reset chooses the instance, by name of the object."""
        return self._sampler.instances

    @property
    def spec(self) -> EnvSpec | None:
        """Spec of ``gym.make``. Its id names this module, so it works in any process."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None and ":" not in spec.id:
            limit = spec.max_episode_steps or self.max_episode_steps
            spec = dataclasses.replace(spec, id=f"{MODULE}:{spec.id}", max_episode_steps=limit)
            assert spec is not None
            spec.kwargs = recordable(spec.kwargs)
        self._spec = spec

    @property
    def _default_sim_config(self) -> SimConfig:
        return self.physics.sim_config(self.profile)

    @property
    def _default_sensor_configs(self) -> list[CameraConfig]:
        return rendering.observation_cameras(self.profile, self.agent.robot.links_map)

    @property
    def _default_human_render_camera_configs(self) -> CameraConfig:
        return rendering.video_camera()

    def reset(
        self, seed: int | list[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Build a new scene. Seeds are integers from 0 to 2**32 - 1; the class docstring describes ``options``.

        Raises:
            InputError: a seed or an option is invalid.
            ClosedEnvError: the environment is closed.
        """
        self._require_open()
        read_options(options, tuple(self.task.objects))
        seed = checked_seed(seed)
        # gymnasium expects that ``seed`` seeds the environment's generator, which is not used here.
        if seed is not None:
            self._np_random, self._np_random_seed = np_random(seed)
        self.reset_options = {key: value for key, value in (options or {}).items() if key in RESET_OPTIONS}
        result: tuple[Any, dict[str, Any]] = super().reset(seed=seed, options=options)
        return result

    def _load_agent(self, options: dict[str, Any], *args: Any, **kwargs: Any) -> None:
        super()._load_agent(options, base_pose(self.profile))
        self._transmission = Transmission(self.agent.robot._objs[0], self.profile)
        self.physics.prepare_robot(self.agent.robot._objs[0], self.profile)

    def _load_scene(self, options: dict[str, Any]) -> None:
        seed = int(self._episode_seed[0])
        setup = self._sampler.sample(seed, options)
        self._robot = SapienRobot(self.profile, self.agent.robot._objs[0])
        self.table = build_table(self.scene, visible=self.scene.can_render())
        self._parts = {name: build_part(self.scene, name, thing, self.physics) for name, thing in setup.objects.items()}
        if setup.has_rigid_objects:
            robot = self.agent.robot._objs[0]
            self.physics.prepare_for_rigid_objects(self.scene.px, robot, self.profile, setup.rigid_classes)
        self._initial_state = setup
        self._prepare_observations(seed)

    def _load_lighting(self, options: dict[str, Any]) -> None:
        rendering.add_lights(self.scene, shadows=self.enable_shadow or self.render_mode is not None)

    def _initialize_episode(self, env_idx: torch.Tensor, options: dict[str, Any]) -> None:
        self.agent.reset(np.array(self.initial_state.start, dtype=np.float32))
        self.agent.robot.set_pose(base_pose(self.profile))
        for part in self._parts.values():
            part.put()
        self._reward = StagedReward(self.task)

    def _before_simulation_step(self) -> None:
        self._transmission.before_substep()
        for part in self._parts.values():
            part.before_substep()

    def show(self, states: Mapping[str, Any], step: int) -> None:
        """Set the objects and the robot to a recorded state. The state may come from any physics engine.

        Args:
            states: recorded states of an episode, in the form of ManiSkill's ``env_states``.
            step: index of the state in ``states``.
        """
        self.set_state_dict(
            {
                kind: {name: torch.from_numpy(np.asarray(rows[step : step + 1])) for name, rows in group.items()}
                for kind, group in states.items()
            }
        )

    def scene_state(self) -> Scene:
        """Return the scene in the planner's form."""
        return read_scene(self._robot, self.parts)

    def evaluate(self) -> dict[str, Any]:
        """Return ``success`` (1,) and the ``openness`` (1,) of each articulated object."""
        measured = self.measure()
        return {
            "success": torch.tensor([all_hold(self.task.success, measured)]),
            "openness": {name: torch.tensor([value]) for name, value in measured.openness.items()},
        }

    def compute_sparse_reward(self, obs: Any, action: torch.Tensor, info: dict[str, Any]) -> torch.Tensor:
        """Return the reward (1,): 1 if the goal is reached, else 0."""
        reward: torch.Tensor = info["success"].to(torch.float32)
        return reward

    def compute_normalized_dense_reward(self, obs: Any, action: torch.Tensor, info: dict[str, Any]) -> torch.Tensor:
        """Return the reward (1,) of :class:`~gensim2.tasks.reward.StagedReward`; 1 if the goal is reached."""
        return torch.tensor([self._reward.of(self.measure())], dtype=torch.float32)

    def step(self, action: Any) -> tuple[Any, torch.Tensor, torch.Tensor, torch.Tensor, dict[str, Any]]:
        """Execute a control step. ``truncated`` is true from step ``max_episode_steps`` on.

        Raises:
            InputError: the action has the wrong shape or is not finite.
            ClosedEnvError: the environment is closed.
        """
        self._require_open()
        action = checked_action(action, self.single_action_space.shape[0], self.agent.supported_control_modes)
        self._note_command(action)
        obs, reward, terminated, _, info = super().step(action)
        return obs, reward, terminated, self.elapsed_steps >= self.max_episode_steps, info

    def close(self) -> None:
        """End the simulation. Later calls of other methods raise ClosedEnvError; ``close`` may be called again."""
        if not self._closed:
            self._closed = True
            super().close()

    def _require_open(self) -> None:
        if self._closed:
            raise ClosedEnvError("the environment is closed; make a new one")

    def render(self) -> Any:
        """Render as in ManiSkill.

        Raises:
            GenSim2Error: no Vulkan driver works, or rendering is off.
        """
        self._require_open()
        if self.render_mode is not None and not self.scene.can_render():
            raise GenSim2Error(NO_DRIVER if not can_render() else "rendering is switched off")
        return super().render()


def check_one_of(value: Any, known: Sequence[str], field: str) -> None:
    """Check that a value is None or one of the known words."""
    if value is not None and value not in known:
        raise InputError(f"must be one of {', '.join(known)}, but is {value!r}", field=field)


OBS_MODES = (
    "raycast",
    "state",
    "state_dict",
    "none",
    "pointcloud",
    "rgb",
    "depth",
    "segmentation",
    "rgb+depth",
    "sensor_data",
)
"""Observation modes listed in errors: ``raycast``, and ManiSkill's most common modes, which can be joined by ``+``."""


def check_obs_mode(obs_mode: str | None, error: Exception) -> None:
    """Raise an InputError if ``error`` of ManiSkill is about the unknown mode ``obs_mode``.

    Raises:
        InputError: ``error`` is about the observation mode.
    """
    if obs_mode is not None and obs_mode != "raycast" and obs_mode in str(error):
        remedy = f"one of {', '.join(OBS_MODES)}; raycast needs no renderer"
        raise InputError(f"no observation mode {obs_mode!r}", field="obs_mode", remedy=remedy) from error


def checked_seed(seed: Any) -> int | None:
    """Return a reset's seed as an integer or None. A vector environment may give a list with a single seed."""
    if isinstance(seed, list | tuple | np.ndarray) and np.ndim(seed) == 1:
        if len(seed) != 1:
            raise InputError(f"must be a single seed for a single environment, not {len(seed)}", field="seed")
        seed = seed[0]
    return None if seed is None else check_seed(seed)


def checked_action(action: Any, size: int, control_modes: Sequence[str]) -> Any:
    """Check and return an action: None, a finite array (size,) or (1, size), or a mapping.

    The mapping is ManiSkill's form ``{"control_mode": ..., "action": ...}``. The number of values depends on the
    control mode, so the function does not check it.
    """
    if action is None:
        return None
    if isinstance(action, Mapping):
        if set(action) != {"control_mode", "action"}:
            raise InputError("a mapping must have the keys control_mode and action", field="action")
        check_one_of(action["control_mode"], control_modes, "control_mode")
        return {**action, "action": _finite(action["action"])}
    values = _finite(action)
    if values.shape not in ((size,), (1, size)):
        raise InputError(f"must be {size} numbers, but has the shape {tuple(values.shape)}", field="action")
    return values


def _finite(action: Any) -> np.ndarray[Any, np.dtype[np.float32]]:
    try:
        values = np.asarray(action.cpu() if isinstance(action, torch.Tensor) else action, dtype=np.float32)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError("must be numbers", field="action") from error
    if not np.isfinite(values).all():
        raise InputError("must be finite", field="action")
    return values

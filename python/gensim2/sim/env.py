"""The one environment: a robot at a table with one articulated object, driven by a task spec."""

from __future__ import annotations

import dataclasses
import gc
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import sapien
import torch
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.seeding import np_random
from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.sensors.camera import CameraConfig
from mani_skill.utils.structs import Articulation
from mani_skill.utils.structs.types import SimConfig

from gensim2.errors import ClosedEnvError, GenSim2Error, InputError
from gensim2.objects.types import Instance
from gensim2.planning.scene import Scene
from gensim2.robots import DEFAULT, robot_names
from gensim2.robots import robot as robot_profile
from gensim2.sim import agents, rendering
from gensim2.sim.arguments import (
    ObjectSource,
    as_library,
    as_task,
    check_one_of,
    check_words,
    checked_action,
    checked_seed,
    chosen_instances,
)
from gensim2.sim.objects import apply_friction, load_object
from gensim2.sim.physics import sim_config
from gensim2.sim.randomize import RESET_OPTIONS, check_options
from gensim2.sim.registration import MODULE
from gensim2.sim.scene_state import read_scene
from gensim2.sim.setup import SceneSetup, set_up
from gensim2.sim.table import build_table
from gensim2.tasks.criteria import succeeded
from gensim2.tasks.spec import TaskSpec


class GenSim2Env(BaseEnv):  # type: ignore[misc]
    """A robot at a table with one articulated object.

    Physics runs at 100 Hz on the CPU, control at 20 Hz. PhysX settings are ManiSkill's, stated
    and fixed here: TGS solver, persistent contact manifold, 15 position iterations and 1 velocity iteration.
    Every reset builds the scene anew, which makes it bitwise repeatable: ``reset(seed=s)`` gives the same
    scene, and the same actions the same states, in any process, with pictures or without.

    An action of the default control mode ``pd_joint_pos`` is (m + 1,): targets of the m arm joints in rad, and
    the gripper from -1 (closed) to 1 (open).

    Args:
        task: name of a library task, a :class:`TaskSpec`, or its fields as a dict.
        assets: as in :func:`gensim2.objects.open_library` (``None``, ``"builtin"`` or a folder), or an opened
            library.
        instances: ``"all"``, ``"train"``, ``"test"``, one id, or several; a reset draws one. An id need not be one
            that the library lists: any number up to 10^6 is a generated object.
        robot: name of its profile (:func:`gensim2.robots.robot_names`); ``robot_uids`` follows from it.
        render_backend: ``"auto"`` renders only where observations or ``render_mode`` need it and a driver
            works.
        kwargs: as in ManiSkill's ``BaseEnv``.

    Reset options, each of which replaces what would have been drawn: ``instance`` (id), ``openness`` (0..1),
    ``offset`` (x, y, yaw from the default placement) or ``pose`` (root in the world: x, y, z, qw, qx, qy,
    qz).

    Raises:
        InputError: an argument or a reset option is wrong.
    """

    SUPPORTED_ROBOTS = [robot_profile(name).agent for name in robot_names()]  # noqa: RUF012 - as the base class has it
    SUPPORTED_REWARD_MODES = ("sparse", "none")

    def __init__(
        self,
        *args: Any,
        task: str | TaskSpec | Mapping[str, Any],
        assets: str | Path | ObjectSource | None = None,
        instances: str | Sequence[str] = "all",
        robot: str = DEFAULT,
        robot_uids: str | None = None,
        control_mode: str | None = "pd_joint_pos",
        num_envs: int = 1,
        sim_backend: str = "physx_cpu",
        render_backend: str = "auto",
        reconfiguration_freq: int | None = None,
        obs_mode: str | None = None,
        render_mode: str | None = None,
        **kwargs: Any,
    ) -> None:
        if num_envs != 1 or sim_backend not in ("cpu", "physx_cpu", "auto"):
            raise InputError("one environment a process, on physx_cpu", field="num_envs", remedy="use processes")
        if reconfiguration_freq not in (None, 1):
            raise InputError("must be 1: an episode is repeatable in a fresh scene only", field="reconfiguration_freq")
        check_one_of(render_mode, self.metadata["render_modes"], "render_mode")
        check_words(obs_mode=obs_mode, control_mode=control_mode, render_backend=render_backend)
        self.robot = robot_profile(robot)
        if robot_uids not in (None, self.robot.agent):
            raise InputError(f"is {self.robot.agent!r}, not {robot_uids!r}", field="robot_uids", remedy="use robot")
        agents.register(self.robot)
        self.task = as_task(task)
        self._library = as_library(assets)
        self._instances = chosen_instances(self._library, self.task, instances)
        self.instance: Instance | None = None
        self._setup: SceneSetup | None = None
        self._spec: EnvSpec | None = None
        self.reset_options: dict[str, Any] = {}
        self._closed = False
        _spare_imports_from_collection()
        try:
            super().__init__(
                *args,
                num_envs=1,
                robot_uids=self.robot.agent,
                control_mode=control_mode,
                sim_backend="physx_cpu",
                render_backend=_render_backend(render_backend, obs_mode, render_mode),
                reconfiguration_freq=1,
                obs_mode=obs_mode,
                render_mode=render_mode,
                **kwargs,
            )
        except (AssertionError, NotImplementedError) as error:  # ManiSkill's word for an argument that it does not know
            raise InputError(f"ManiSkill refuses an argument: {error}", remedy="see its BaseEnv") from error
        except RuntimeError as error:
            if "failed to find device" not in str(error):
                raise
            raise InputError(f"{error}", field="render_backend", remedy="use 'auto' or 'none'") from error

    @property
    def max_episode_steps(self) -> int:
        """Control steps after which an episode is truncated."""
        return self.task.max_episode_steps

    @property
    def instance_ids(self) -> tuple[str, ...]:
        """Ids that a reset draws from."""
        return self._instances

    @property
    def spec(self) -> EnvSpec | None:
        """The spec that ``gym.make`` gave, its id with the module to import in front, so that a recorder
        writes an id that works in a process that knows nothing of gensim2."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None and ":" not in spec.id:
            spec = dataclasses.replace(spec, id=f"{MODULE}:{spec.id}")
            assert spec is not None
            spec.kwargs = _jsonable(spec.kwargs)
        self._spec = spec

    # ------------------------------------------------------------------ scene

    @property
    def _default_sim_config(self) -> SimConfig:
        return sim_config(self.robot.physics_hz, self.robot.control_hz)

    @property
    def _default_sensor_configs(self) -> list[CameraConfig]:
        return rendering.observation_cameras()

    @property
    def _default_human_render_camera_configs(self) -> CameraConfig:
        return rendering.video_camera()

    def reset(
        self, seed: int | list[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Build a fresh scene; see the class for ``options``. Seeds are whole numbers from 0 to 2**32 - 1.

        Raises:
            InputError: a seed or an option cannot be used.
            ClosedEnvError: the environment is closed.
        """
        self._require_open()
        check_options(options)
        seed = checked_seed(seed)
        if seed is not None:  # gymnasium's own generator, which nothing here draws from
            self._np_random, self._np_random_seed = np_random(seed)
        self.reset_options = {key: value for key, value in (options or {}).items() if key in RESET_OPTIONS}
        result: tuple[Any, dict[str, Any]] = super().reset(seed=seed, options=options)
        return result

    def _load_agent(self, options: dict[str, Any], *args: Any, **kwargs: Any) -> None:
        super()._load_agent(options, sapien.Pose(p=list(self.robot.base_position)))

    def _load_scene(self, options: dict[str, Any]) -> None:
        seed = int(self._episode_seed[0])
        setup = set_up(self.task, self._library, self._instances, seed, options)
        self._setup, self.instance, self.object_yaw = setup, setup.instance, setup.yaw
        self.initial_openness = setup.openness
        self.table = build_table(self.scene, visible=self.scene.can_render())
        self.object: Articulation
        pose = sapien.Pose(setup.position, setup.quaternion)
        self.object, self.object_warnings = load_object(self.scene, setup.instance, pose)

    def _load_lighting(self, options: dict[str, Any]) -> None:
        rendering.add_lights(self.scene, shadows=self.enable_shadow or self.render_mode is not None)

    def _initialize_episode(self, env_idx: torch.Tensor, options: dict[str, Any]) -> None:
        self.agent.reset(np.array(self.robot.reset_qpos, dtype=np.float32))
        self.agent.robot.set_pose(sapien.Pose(p=list(self.robot.base_position)))
        assert self._setup is not None
        self.object.set_qpos(torch.tensor([[self._setup.joint_value]], dtype=torch.float32))
        self.object.set_qvel(torch.zeros((1, 1)))

    def _before_simulation_step(self) -> None:
        instance = self._require_instance()
        if instance.joint.damping > 0:
            apply_friction(self.object._objs[0], instance, float(self.object._objs[0].qvel[0]))

    def _require_instance(self) -> Instance:
        self._require_open()
        if self.instance is None:
            raise GenSim2Error("the environment has not been reset yet")
        return self.instance

    # ------------------------------------------------------------ measurement

    @property
    def openness(self) -> float:
        """(q - lower) / (upper - lower) of the object's joint; may leave 0..1 by the joint's give."""
        joint = self._require_instance().joint
        value = float(self.object.get_qpos()[0, 0])
        return (value - joint.lower) / (joint.upper - joint.lower)

    def scene_state(self) -> Scene:
        """The scene as the planner sees it, in the robot base frame; geometry only."""
        instance = self._require_instance()
        return read_scene(self.agent.robot._objs[0], self.robot, self.object._objs[0], instance, self.object_yaw)

    def evaluate(self) -> dict[str, torch.Tensor]:
        """``success`` (1,) bool: every criterion of the task holds now; ``openness`` (1,)."""
        openness = self.openness
        return {
            "success": torch.tensor([succeeded(self.task, openness)]),
            "openness": torch.tensor([openness], dtype=torch.float32),
        }

    def _get_obs_extra(self, info: dict[str, Any]) -> dict[str, torch.Tensor]:
        """Hand pose in the world; with state observations also where the object and its link stand."""
        extra = {"tcp_pose": self.agent.robot.links_map[self.robot.tool_link].pose.raw_pose}
        if self.obs_mode_struct.use_state:
            extra |= {
                "openness": info["openness"],
                "object_qpos": self.object.get_qpos(),
                "object_pose": self.object.pose.raw_pose,
                "moving_link_pose": self.object.links_map[self._require_instance().joint.child_link].pose.raw_pose,
            }
        return extra

    def compute_sparse_reward(self, obs: Any, action: torch.Tensor, info: dict[str, Any]) -> torch.Tensor:
        """(1,) float: 1 where the task's criteria hold, else 0."""
        reward: torch.Tensor = info["success"].to(torch.float32)
        return reward

    def step(self, action: Any) -> tuple[Any, torch.Tensor, torch.Tensor, torch.Tensor, dict[str, Any]]:
        """One control step (0.05 s). ``truncated`` from ``task.max_episode_steps`` on.

        Raises:
            InputError: the action has the wrong shape or is not finite.
            ClosedEnvError: the environment is closed.
        """
        self._require_open()
        action = checked_action(action, self.single_action_space.shape[0], self.agent.supported_control_modes)
        obs, reward, terminated, _, info = super().step(action)
        return obs, reward, terminated, self.elapsed_steps >= self.max_episode_steps, info

    def close(self) -> None:
        """End the simulation; a second time does nothing. Afterwards every other call is a ClosedEnvError."""
        if not self._closed:
            self._closed = True
            super().close()

    def _require_open(self) -> None:
        if self._closed:
            raise ClosedEnvError("the environment is closed; make a new one")

    def render(self) -> Any:
        """As in ManiSkill.

        Raises:
            GenSim2Error: no Vulkan driver works, or rendering was switched off.
        """
        self._require_open()
        if self.render_mode is not None and not self.scene.can_render():
            raise GenSim2Error(rendering.NO_DRIVER if not rendering.can_render() else "rendering is switched off")
        return super().render()


def _render_backend(asked: str, obs_mode: str | None, render_mode: str | None) -> str:
    needs_pictures = obs_mode not in (None, "none", "state", "state_dict")
    if asked == "none":
        if needs_pictures:
            raise InputError(f"obs_mode {obs_mode!r} needs rendering", field="render_backend")
        return "none"
    if asked != "auto":
        return asked
    if needs_pictures and not rendering.can_render():
        raise InputError(rendering.NO_DRIVER, field="obs_mode", remedy="use obs_mode 'state'")
    if not (needs_pictures or render_mode is not None) or not rendering.can_render():
        # Without a driver an environment with a render mode still simulates; render() itself then says why
        # not.
        return "none"
    return "gpu" if torch.cuda.is_available() else "cpu"


@cache
def _spare_imports_from_collection() -> None:
    """Exempt what is alive now, ManiSkill's and torch's modules above all, from garbage collection, once a
    process.

    ManiSkill runs a full collection at every reset; this makes it cost 2 ms instead of 180.
    """
    gc.collect()
    gc.freeze()


def _jsonable(kwargs: Mapping[str, Any]) -> dict[str, Any]:
    """Environment arguments as a recorder can write them."""
    plain = dict(kwargs)
    if isinstance(plain.get("task"), TaskSpec):
        plain["task"] = plain["task"].model_dump(mode="json")
    if isinstance(plain.get("assets"), Path):
        plain["assets"] = str(plain["assets"])
    if isinstance(plain.get("instances"), tuple):
        plain["instances"] = list(plain["instances"])
    return plain


def make_env(
    task: str | TaskSpec | Mapping[str, Any],
    *,
    assets: str | Path | ObjectSource | None = None,
    instances: str | Sequence[str] = "all",
    robot: str = DEFAULT,
    obs_mode: str = "state",
    render_mode: str | None = None,
) -> GenSim2Env:
    """A :class:`GenSim2Env` without gymnasium's wrappers, typed: what gensim2's own rollouts use.

    It behaves as ``gym.make(env_id(task), ...)`` does.
    """
    return GenSim2Env(
        task=task, assets=assets, instances=instances, robot=robot, obs_mode=obs_mode, render_mode=render_mode
    )

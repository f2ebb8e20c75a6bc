"""Robots in physics equal ManiSkill's agents bit for bit, with the drives of their profiles."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("mani_skill")

import sapien
from mani_skill.agents.registration import REGISTERED_AGENTS
from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.utils.structs.types import SimConfig

from gensim2.core.errors import InputError
from gensim2.perception.observation import tool_pose
from gensim2.robots import RobotProfile, robot
from gensim2.sim import agents
from gensim2.sim.arm import Arm, base_pose
from gensim2.sim.gripper import Transmission
from gensim2.sim.physics import DEFAULT


class AloneEnv(BaseEnv):  # type: ignore[misc]
    """ManiSkill's agent of a profile alone."""

    SUPPORTED_REWARD_MODES = ("none",)

    def __init__(self, profile: RobotProfile) -> None:
        self.profile = profile
        agents.register(profile)
        super().__init__(
            robot_uids=profile.agent,
            control_mode="pd_joint_pos",
            num_envs=1,
            sim_backend="physx_cpu",
            render_backend="none",
            obs_mode="none",
            reward_mode="none",
        )

    @property
    def _default_sim_config(self) -> SimConfig:
        return DEFAULT.sim_config(self.profile)

    def _load_agent(self, options: dict[str, Any], *args: Any, **kwargs: Any) -> None:
        super()._load_agent(options, base_pose(self.profile))
        self.transmission = Transmission(self.agent.robot._objs[0], self.profile)

    def _before_simulation_step(self) -> None:
        self.transmission.before_substep()

    def _load_scene(self, options: dict[str, Any]) -> None:
        pass

    def _load_lighting(self, options: dict[str, Any]) -> None:
        pass

    def _initialize_episode(self, env_idx: Any, options: dict[str, Any]) -> None:
        self.agent.reset(np.array(self.profile.reset_qpos, dtype=np.float32))
        self.agent.robot.set_pose(base_pose(self.profile))

    def evaluate(self) -> dict[str, Any]:
        return {}


class Alone:
    """The same in SAPIEN's own scene."""

    def __init__(self, profile: RobotProfile) -> None:
        self.profile = profile
        self.system = DEFAULT.new_system(profile)
        self.scene = sapien.Scene([self.system])
        self.arm = Arm(self.scene, profile, DEFAULT)
        self.arm.put(profile.reset_qpos)

    def step(self, action: np.ndarray) -> None:
        self.arm.drive(action)
        for _ in range(self.profile.substeps):
            self.arm.transmission.before_substep()
            self.system.step()


def test_states_are_those_of_maniskills_agent(any_robot: str) -> None:
    profile, draw = robot(any_robot), np.random.default_rng(3)
    env = AloneEnv(profile)
    env.reset(seed=0)
    alone, built = Alone(profile), env.agent.robot._objs[0]
    names = [joint.name.rsplit("/")[-1] for joint in built.active_joints]
    assert [joint.name for joint in alone.arm.articulation.active_joints] == [
        *profile.arm_joints,
        *profile.gripper.joints,
    ]
    assert all(mine in theirs for mine, theirs in zip(profile.arm_joints, names, strict=False))
    assert env.action_space.shape == (profile.action_size,)
    for _ in range(60):
        action = profile.rest_action + draw.uniform(-0.4, 0.4, profile.action_size).astype(np.float32)
        env.step(action)
        alone.step(action)
        assert np.array_equal(built.qpos, alone.arm.articulation.qpos)
        assert np.array_equal(built.qvel, alone.arm.articulation.qvel)
    tool = env.agent.robot.links_map[profile.tool_link].pose.raw_pose[0].numpy()
    worked_out = tool_pose(profile, alone.arm.articulation.qpos)
    assert np.abs(tool[:3] - profile.base_position - worked_out[:3]).max() < 5e-6
    assert abs(abs(tool[3:] @ worked_out[3:]) - 1) < 1e-6
    env.close()


def test_drives_lag_by_what_the_profile_says(any_robot: str) -> None:
    """Behind targets of constant speed, for each arm joint."""
    profile = robot(any_robot)
    speed = 0.3  # rad/s, slow enough for the force limits
    for index in range(profile.arm_size):
        alone, target = Alone(profile), profile.rest_action.copy()
        towards = 1.0 if profile.reset_qpos[index] <= 0 else -1.0
        for _ in range(2 * profile.control_hz):
            target[index] += towards * speed / profile.control_hz
            alone.step(target)
        behind = towards * (target[index] - alone.arm.articulation.qpos[index]) / speed
        # A target is held for a whole control step, so the delay at its end is up to a step less.
        lag = profile.lags[index]
        assert lag - 1.0 / profile.control_hz < behind < lag + 0.02, profile.arm_joints[index]


def test_fingers_go_all_the_way_in_the_time_they_are_given(any_robot: str) -> None:
    profile = robot(any_robot)
    alone, action = Alone(profile), profile.rest_action.copy()
    for command, end in ((-1.0, 0.0), (1.0, profile.gripper.widest)):
        action[-1] = command
        for _ in range(profile.gripper_steps):
            alone.step(action)
        assert profile.gripper.opening(alone.arm.reader.q[profile.arm_size :]) == pytest.approx(end, abs=4e-3)


def test_the_panda_is_maniskills() -> None:
    profile = robot("panda")
    from mani_skill.agents.robots.panda.panda import Panda

    assert REGISTERED_AGENTS["panda"].agent_cls is Panda
    assert Panda.urdf_path == str(profile.urdf)
    assert list(profile.arm_joints) == Panda.arm_joint_names
    assert list(profile.gripper.joints) == Panda.gripper_joint_names
    assert profile.tool_link == Panda.ee_link_name
    assert agents.urdf_config(profile.gripper.friction, profile.gripper.pads) == Panda.urdf_config
    drive = profile.arm_drives[0]
    assert (drive.stiffness, drive.damping, drive.force_limit) == (
        Panda.arm_stiffness,
        Panda.arm_damping,
        Panda.arm_force_limit,
    )
    env = AloneEnv(profile)
    fingers = env.agent.controller.configs["gripper"]
    assert (fingers.lower, fingers.upper) == profile.gripper.range
    motor = profile.simulation.gripper
    assert (fingers.stiffness, fingers.damping, fingers.force_limit) == (
        motor.stiffness,
        motor.damping,
        motor.force_limit,
    )
    env.close()


def test_actions_that_cannot_be_used_are_refused() -> None:
    alone = Alone(robot("panda"))
    for action in (np.zeros(7), np.full(8, np.nan)):
        with pytest.raises(InputError, match="must be 8 finite numbers"):
            alone.arm.drive(action)

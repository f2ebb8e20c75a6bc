"""Robot profiles as ManiSkill's agents: its own where it has one, else one made of the profile."""

from __future__ import annotations

from typing import Any, ClassVar

from mani_skill.agents.base_agent import BaseAgent
from mani_skill.agents.controllers import PDJointPosControllerConfig, PDJointPosMimicControllerConfig, deepcopy_dict
from mani_skill.agents.registration import REGISTERED_AGENTS, register_agent

from gensim2.robots import RobotProfile

PATCH_RADIUS = 0.1
"""Metres; of the fingers' surface, as ManiSkill's agents have it."""


def urdf_config(profile: RobotProfile) -> dict[str, Any]:
    """Materials of the fingers, as ManiSkill's agents and their loader take them."""
    friction = profile.gripper.friction
    pad = {"material": "gripper", "patch_radius": PATCH_RADIUS, "min_patch_radius": PATCH_RADIUS}
    return {
        "_materials": {"gripper": {"static_friction": friction, "dynamic_friction": friction, "restitution": 0.0}},
        "link": {name: dict(pad) for name in profile.gripper.links},
    }


def register(profile: RobotProfile) -> None:
    """Make ``profile.agent`` known to ManiSkill where it is not; a second time does nothing.

    Raises:
        MissingExtraError: the robot's files come with a package that is not installed.
    """
    if profile.agent in REGISTERED_AGENTS:
        return
    fields = {
        "uid": profile.agent,
        "profile": profile,
        "urdf_path": str(profile.urdf),
        "urdf_config": urdf_config(profile),
    }
    register_agent()(type(f"{profile.name.capitalize()}Agent", (ProfileAgent,), fields))


class ProfileAgent(BaseAgent):  # type: ignore[misc]
    """An agent with the numbers of a profile; its control modes are ``pd_joint_pos`` and ``pd_joint_delta_pos``."""

    profile: ClassVar[RobotProfile]

    @property
    def _controller_configs(self) -> dict[str, Any]:
        profile, fingers = self.profile, self.profile.gripper
        drive = {"stiffness": profile.stiffness, "damping": profile.damping, "force_limit": profile.force_limit}
        arm = list(profile.arm_joints)
        gripper = PDJointPosMimicControllerConfig(
            list(fingers.joints),
            lower=fingers.closed,
            upper=fingers.open,
            stiffness=fingers.stiffness,
            damping=fingers.damping,
            force_limit=fingers.force_limit,
            mimic={fingers.joints[1]: {"joint": fingers.joints[0]}},
        )
        modes: dict[str, Any] = deepcopy_dict(
            {
                "pd_joint_pos": {
                    "arm": PDJointPosControllerConfig(arm, lower=None, upper=None, normalize_action=False, **drive),
                    "gripper": gripper,
                },
                "pd_joint_delta_pos": {
                    "arm": PDJointPosControllerConfig(arm, lower=-0.1, upper=0.1, use_delta=True, **drive),
                    "gripper": gripper,
                },
            }
        )
        return modes

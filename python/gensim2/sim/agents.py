"""Register robot profiles as ManiSkill agents."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

from mani_skill.agents.base_agent import BaseAgent
from mani_skill.agents.controllers import PDJointPosControllerConfig, PDJointPosMimicControllerConfig, deepcopy_dict
from mani_skill.agents.registration import REGISTERED_AGENTS, register_agent
from mani_skill.utils import sapien_utils

from gensim2.core.errors import InputError
from gensim2.robots import RobotProfile

PATCH_RADIUS = 0.1
"""Patch radius of the fingers' surface (m), as in ManiSkill's agents."""


def urdf_config(friction: float, pads: Sequence[str]) -> dict[str, Any]:
    """Return the friction settings of the pad links in the format of ManiSkill's agents and loader."""
    pad = {"material": "gripper", "patch_radius": PATCH_RADIUS, "min_patch_radius": PATCH_RADIUS}
    return {
        "_materials": {"gripper": {"static_friction": friction, "dynamic_friction": friction, "restitution": 0.0}},
        "link": {name: dict(pad) for name in pads},
    }


def register(profile: RobotProfile) -> None:
    """Register ``profile.agent`` with ManiSkill, unless ManiSkill knows this agent.

    Raises:
        MissingExtraError: the robot's files are in a package that is not installed.
        InputError: another agent has the same name.
    """
    known = REGISTERED_AGENTS.get(profile.agent)
    if known is not None:
        other = getattr(known.agent_cls, "profile", profile)
        if other is not profile or known.agent_cls.urdf_path != str(profile.urdf):
            raise InputError(
                f"ManiSkill already has another agent with the name {profile.agent!r}",
                field=f"{profile.name}.simulation.agent",
                remedy="give the agent of this robot another name",
            )
        return
    fields = {
        "uid": profile.agent,
        "profile": profile,
        "urdf_path": str(profile.urdf),
        "urdf_config": urdf_config(profile.gripper.friction, profile.gripper.pads),
    }
    register_agent()(type(f"{profile.name.capitalize()}Agent", (ProfileAgent,), fields))


class ProfileAgent(BaseAgent):  # type: ignore[misc]
    """ManiSkill agent of a robot profile, with the control modes ``pd_joint_pos`` and ``pd_joint_delta_pos``."""

    profile: ClassVar[RobotProfile]

    @property
    def _controller_configs(self) -> dict[str, Any]:
        profile, drive, hand = self.profile, self.profile.simulation.gripper, self.profile.gripper
        gains = {
            "stiffness": [each.stiffness for each in profile.arm_drives],
            "damping": [each.damping for each in profile.arm_drives],
            "force_limit": [each.force_limit for each in profile.arm_drives],
        }
        arm = list(profile.arm_joints)
        first, *others = hand.driven
        lower, upper = hand.range
        limits = {"lower": lower, "upper": upper}
        motors = {"stiffness": drive.stiffness, "damping": drive.damping, "force_limit": drive.force_limit}
        gripper = (
            PDJointPosMimicControllerConfig(
                [first, *others], **limits, **motors, mimic={name: {"joint": first} for name in others}
            )
            if others
            else PDJointPosControllerConfig([first], **limits, **motors)
        )
        modes: dict[str, Any] = deepcopy_dict(
            {
                "pd_joint_pos": {
                    "arm": PDJointPosControllerConfig(arm, lower=None, upper=None, normalize_action=False, **gains),
                    "gripper": gripper,
                },
                "pd_joint_delta_pos": {
                    "arm": PDJointPosControllerConfig(arm, lower=-0.1, upper=0.1, use_delta=True, **gains),
                    "gripper": gripper,
                },
            }
        )
        return modes

    def _load_articulation(self, initial_pose: Any = None) -> None:
        """Load the robot as ManiSkill does. Fixed tendons couple mimic joints only if the profile says so."""
        loader = self.scene.create_urdf_loader()
        loader.name, loader.fix_root_link = self.uid, self.fix_root_link
        sapien_utils.apply_urdf_config(loader, sapien_utils.parse_urdf_config(self.urdf_config))
        builder = loader.parse(self.urdf_path)["articulation_builders"][0]
        builder.initial_pose = initial_pose
        self.robot = builder.build(build_mimic_joints=self.profile.simulation.tendons)
        self.robot_link_names = [link.name for link in self.robot.get_links()]

"""Check that a robot profile is consistent and matches its URDF."""

from __future__ import annotations

import re
from math import isclose
from typing import Protocol

import numpy as np

import gensim2_kpam
from gensim2.core.errors import InputError
from gensim2.core.foreign.geometry import MAX_URDF
from gensim2.core.foreign.tree import read_input
from gensim2.robots.profile import RobotProfile

KEYPOINTS = ("tool_head", "tool_tail", "tool_side")
NEAR = 1e-6
CAMERA_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")


class Refuse(Protocol):
    """Type of a function that creates an error about a field of the profile."""

    def __call__(self, field: str, message: str, remedy: str | None = None) -> InputError: ...


def check_profile(profile: RobotProfile, where: str) -> None:
    """Raise an error if a profile is inconsistent or contradicts the URDF of the robot.

    Args:
        where: file or module of the profile, for the message.

    Raises:
        InputError: the profile is inconsistent; the message names the field.
    """

    def refuse(field: str, message: str, remedy: str | None = None) -> InputError:
        return InputError(message, file=where, field=f"{profile.name}.{field}", remedy=remedy)

    rates = profile.simulation.physics_hz, profile.control_hz
    if min(rates) <= 0 or rates[0] % rates[1]:
        wrong = f"the physics rate, {rates[0]} Hz, is not a multiple of the control rate, {rates[1]} Hz"
        raise refuse("control_hz", wrong)
    if not isclose(sum(each * each for each in profile.base_quaternion), 1.0, abs_tol=NEAR):
        raise refuse("base_quaternion", f"must be a unit quaternion (w, x, y, z), but is {profile.base_quaternion}")
    missing = [name for name in KEYPOINTS if name not in profile.tool_keypoints]
    if missing:
        raise refuse("tool_keypoints", f"the keypoint {missing[0]} is missing")
    for point in profile.tool_keypoints.values():
        if np.shape(point) != (3,) or not np.isfinite(point).all():
            raise refuse("tool_keypoints", "each keypoint must be three finite numbers: metres in the hand frame")
    if len(profile.arm_drives) != len(profile.arm_joints):
        raise refuse("simulation.arm", f"has {len(profile.arm_drives)} drives for {len(profile.arm_joints)} arm joints")
    _check_gripper(profile, refuse)
    _check_joints(profile, refuse)
    _check_cameras(profile, refuse)


def _check_gripper(profile: RobotProfile, refuse: Refuse) -> None:
    gripper = profile.gripper
    named = {"driven": gripper.driven, "fingers": gripper.fingers, "mimics": gripper.mimics, "passive": gripper.passive}
    for field, names in named.items():
        unknown = [name for name in names if name not in gripper.joints]
        if unknown:
            raise refuse(f"gripper.{field}", f"{unknown[0]!r} is not in gripper.joints")
    for name in gripper.joints:
        kinds = [field for field in ("driven", "mimics", "passive") if name in named[field]]
        if len(kinds) != 1:
            said = " and ".join(kinds) or "no field"
            raise refuse(
                "gripper.joints",
                f"{name!r} is listed in {said}, but must be listed in exactly one of driven, mimics and passive",
            )
    if not gripper.widest > 0.0:
        raise refuse("gripper.widest", "the largest pad distance must be above 0 m")
    for name, mimic in gripper.mimics.items():
        if mimic.joint not in gripper.driven or mimic.multiplier == 0.0:
            wrong = f"the joint {name!r} must follow a driven joint with a multiplier other than 0"
            raise refuse("gripper.mimics", wrong)


def _check_cameras(profile: RobotProfile, refuse: Refuse) -> None:
    names = [camera.name for camera in profile.cameras]
    if len(set(names)) < len(names):
        raise refuse("cameras", f"two cameras are named {max(names, key=names.count)!r}")
    for camera in profile.cameras:
        field = f"cameras.{camera.name}"
        if not CAMERA_NAME.fullmatch(camera.name):
            raise refuse(
                field,
                "a camera name must have 1 to 40 lower-case letters, digits or underscores, and begin with a letter",
            )
        if camera.link not in profile.model.link_names:
            raise refuse(field, f"the URDF has no link {camera.link!r}")
        pose = np.asarray(camera.T_link_camera, dtype=np.float64)
        if (
            pose.shape != (4, 4)
            or not np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=NEAR)
            or not np.linalg.det(pose[:3, :3]) > 0
            or not np.array_equal(pose[3], [0.0, 0.0, 0.0, 1.0])
        ):
            raise refuse(f"{field}.T_link_camera", "must be a rigid transform of shape (4, 4)")
        if min(camera.width, camera.height) < 1 or not 0.0 < camera.field_of_view < 3.0:
            raise refuse(
                field, "width and height must be at least 1 pixel, and the field of view must lie between 0 and 3 rad"
            )


def _check_joints(profile: RobotProfile, refuse: Refuse) -> None:
    model, gripper = profile.model, profile.gripper
    expected = [*profile.arm_joints, *gripper.joints]
    if model.joint_names != expected:
        raise refuse(
            "arm_joints",
            f"the profile lists the joints {', '.join(expected)}, but the moving joints of the URDF "
            f"are {', '.join(model.joint_names)}",
            "list all moving joints in the order of the URDF; the joints of the arm must come first; unused joints "
            "must be fixed joints in the URDF",
        )
    for field, link in (("hand_link", profile.hand_link), ("tool_link", profile.tool_link)):
        if link not in model.link_names:
            raise refuse(field, f"the URDF has no link {link!r}")
    missing = [link for link in gripper.pads if link not in model.link_names]
    if missing:
        raise refuse("gripper.pads", f"the URDF has no link {missing[0]!r}")
    q = np.asarray(profile.reset_qpos, dtype=np.float64)
    if q.shape != (len(expected),):
        raise refuse("reset_qpos", f"has {q.size} values for {len(expected)} joints")
    outside = [
        name
        for name, value, low, high in zip(expected, q, model.lower, model.upper, strict=True)
        if not low - 1e-4 <= value <= high + 1e-4
    ]
    if outside:
        raise refuse("reset_qpos", f"places the joint {outside[0]} outside its limits")
    _check_mimics(profile, refuse)


def _check_mimics(profile: RobotProfile, refuse: Refuse) -> None:
    """Check that the ``<mimic>`` elements of the URDF agree with the profile. The planner reads only these elements."""
    written = gensim2_kpam.read_urdf(read_input(profile.urdf, MAX_URDF), str(profile.urdf))
    followed = {joint["name"]: joint["mimic"] for joint in written["joints"]}
    remedy = "give the joint a <mimic> element with these numbers"
    for name, mimic in profile.gripper.mimics.items():
        if followed[name] != {"joint": mimic.joint, "multiplier": mimic.multiplier, "offset": mimic.offset}:
            raise refuse(
                "gripper.mimics",
                f"the profile has {mimic} for the joint {name!r}, but its <mimic> element in the URDF differs",
                remedy,
            )
    for name in profile.gripper.passive:
        if followed[name] is None or followed[name]["multiplier"] != 0.0:
            remedy = f'give the joint <mimic joint="{profile.gripper.driven[0]}" multiplier="0"/>'
            raise refuse(
                "gripper.passive",
                f"the passive joint {name!r} must have a <mimic> element with multiplier 0 in the URDF",
                remedy,
            )

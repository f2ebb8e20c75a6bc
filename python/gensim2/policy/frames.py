r"""Convert observations to inputs of the network, in a frame that rotates with the robot's first joint.

The first joint of a robot such as the Panda rotates the robot about the z axis of its base. A policy should act in the
same way if scene and robot are rotated about this axis. Therefore clouds and tool poses are rotated by
:math:`R_z(-q_1)`. The first joint's position :math:`q_1` is no input, and actions are relative to the present joints.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch

from gensim2.core.errors import InputError
from gensim2.perception.observation import CLOUD, GRIPPER, STATE, TOOL_POSE, VELOCITY
from gensim2.policy.rotations import matrix_of_quaternion, matrix_of_six, six_of_matrix

if TYPE_CHECKING:
    from gensim2.policy.config import PolicyConfig
    from gensim2.robots import RobotProfile

SEEN = (CLOUD, STATE, VELOCITY, TOOL_POSE, GRIPPER)
"""Observation columns that a policy uses, (B, T, ...) with T frames of which the last is the present one."""


@dataclass(frozen=True)
class Inputs:
    """Inputs of the network in the policy's frame (see the module), in SI units. Settings select the optional inputs.

    Attributes:
        cloud: (B, T, N, C) points. The channels are x, y, z (m), then red, green, blue (0 to 1) if ``colour`` is set,
            then the coordinates in the tool frame (m) if ``tool_frame`` is set.
        proprio: (B, T, P) arm joints (with ``joints``), their velocities (with ``velocity``), tool position, tool
            rotation as six numbers, gripper width, and last gripper command. With the frame ``turned``, the first joint
            is relative to its present position.
    """

    cloud: torch.Tensor
    proprio: torch.Tensor


def cloud_size(config: PolicyConfig) -> int:
    """Return C, the number of channels of a point."""
    return 3 + 3 * config.colour + 3 * config.tool_frame


def proprio_size(config: PolicyConfig, arm: int) -> int:
    """Return P, the number of proprioception values, for an arm with ``arm`` joints."""
    return arm * (config.joints + config.velocity) + 3 + 6 + 2


def turn_matrix(angle: torch.Tensor) -> torch.Tensor:
    """Return the rotation matrices (..., 3, 3) about z for angles (...) in rad."""
    c, s, zero, one = torch.cos(angle), torch.sin(angle), torch.zeros_like(angle), torch.ones_like(angle)
    rows = [torch.stack(row, -1) for row in ((c, -s, zero), (s, c, zero), (zero, zero, one))]
    return torch.stack(rows, -2)


def policy_frame(state: torch.Tensor, config: PolicyConfig) -> torch.Tensor:
    """Return the rotation ``R_policy_base`` (B, 3, 3) from the base frame into the policy's frame.

    Args:
        state: (B, T, n) joint positions at T time steps, rad. The last time step is the present.
    """
    angle = -state[:, -1, 0] if config.frame == "turned" else torch.zeros_like(state[:, -1, 0])
    return turn_matrix(angle)


def inputs_of(seen: Mapping[str, torch.Tensor], config: PolicyConfig, arm: int) -> Inputs:
    """Convert observations to the inputs of the network.

    Args:
        seen: observation arrays (B, T, ...) with the names in ``SEEN``. Poses and points are in the base frame.
        arm: number of the arm's joints. These joints come first in the arrays of joint positions and velocities.
    """
    state = seen[STATE]
    R = policy_frame(state, config)
    joints = state[..., :arm]
    if config.frame == "turned":
        joints = torch.cat([joints[..., :1] - joints[:, -1:, :1], joints[..., 1:]], -1)
    pose = seen[TOOL_POSE]
    position = torch.einsum("bij,btj->bti", R, pose[..., :3])
    rotation = torch.einsum("bij,btjk->btik", R, matrix_of_quaternion(pose[..., 3:]))
    own = [joints] if config.joints else []
    if config.velocity:
        own.append(seen[VELOCITY][..., :arm])
    own += [position, six_of_matrix(rotation), seen[GRIPPER]]

    xyz = torch.einsum("bij,btnj->btni", R, seen[CLOUD][..., :3])
    points = [xyz]
    if config.colour:
        points.append(seen[CLOUD][..., 3:6])
    if config.tool_frame:
        points.append(torch.einsum("btji,btnj->btni", rotation, xyz - position[:, :, None]))
    return Inputs(torch.cat(points, -1), torch.cat(own, -1))


def tool_in(proprio: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return position (B, 3), m, and rotation (B, 3, 3) of the tool in the policy's frame.

    Args:
        proprio: (B, P), as in :class:`Inputs`.
    """
    return proprio[:, -11:-8], matrix_of_six(proprio[:, -8:-2])


def yawed(seen: Mapping[str, torch.Tensor], angle: torch.Tensor) -> dict[str, torch.Tensor]:
    """Return the observation after rotating scene and robot by ``angle`` (B,), rad, about the base's z axis.

    The rotation leaves relative actions unchanged. It adds ``angle`` to the first joint of absolute actions.
    """
    R = turn_matrix(angle)
    found = dict(seen)
    cloud, pose = seen[CLOUD], seen[TOOL_POSE]
    found[CLOUD] = torch.cat([torch.einsum("bij,btnj->btni", R, cloud[..., :3]), cloud[..., 3:]], -1)
    state = seen[STATE].clone()
    state[..., 0] += angle[:, None]
    found[STATE] = state
    half = angle / 2
    c, s = torch.cos(half)[:, None], torch.sin(half)[:, None]
    w, x, y, z = pose[..., 3:].unbind(-1)
    turned = torch.stack([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w], -1)
    # Of the two quaternions q and -q of a rotation, observations contain the one with qw >= 0.
    turned = torch.where(turned[..., :1] < 0, -turned, turned)
    found[TOOL_POSE] = torch.cat([torch.einsum("bij,btj->bti", R, pose[..., :3]), turned], -1)
    return found


def check_turns(profile: RobotProfile, config: PolicyConfig) -> None:
    """Check that a ``turned`` policy fits this robot. Its first joint must rotate about the z axis of the base.

    Raises:
        InputError: the first joint rotates about a different axis; train with the frame setting ``base`` instead.
    """
    if config.frame != "turned":
        return
    angle = 0.3
    q = np.array(profile.reset_qpos, dtype=np.float64)
    before = profile.model.forward_kinematics(q, profile.tool_link)
    q[0] += angle
    after = profile.model.forward_kinematics(q, profile.tool_link)
    expected = np.eye(4)
    expected[:3, :3] = turn_matrix(torch.tensor(angle, dtype=torch.float64)).numpy()
    if not np.allclose(after, expected @ before, atol=1e-6):
        message = f"the first joint of {profile.name} does not turn it about the z axis of its base"
        raise InputError(
            message, field="frame", remedy="train action chunks with frame: base (gensim2 train --frame base)"
        )

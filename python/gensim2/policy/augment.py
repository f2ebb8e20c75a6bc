"""Augment training batches.

The augmentations are point jitter, point dropout, a colour shift, a yaw rotation of the scene, and noise on the arm's
joints.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import torch

from gensim2.perception.observation import CLOUD, GRIPPER, STATE, TOOL_POSE, tool_pose
from gensim2.policy.frames import yawed
from gensim2.policy.heads.actions import ACTION
from gensim2.policy.keyframes import KEY_POSITIONS, KEY_ROTATIONS
from gensim2.policy.rotations import matrix_of_quaternion

if TYPE_CHECKING:
    from gensim2.policy.config import TrainConfig
    from gensim2.robots import RobotProfile

OFF = 0.5
"""Fraction of samples whose arm joints are perturbed."""
HOLDS_COMMAND, HOLDS_WIDTH = 0.9, 0.004
"""Fingers may hold an object if their command is below ``HOLDS_COMMAND`` and their distance above ``HOLDS_WIDTH``
(m).
"""


def augmented(
    seen: Mapping[str, torch.Tensor], training: TrainConfig, generator: torch.Generator, *, ordered: bool = False
) -> dict[str, torch.Tensor]:
    """Augment a batch by point dropout, jitter, colour shift and yaw.

    Dropped points are replaced by copies of other points. In each sample a random fraction of up to
    ``training.dropout`` is dropped.

    Args:
        seen: observation columns (B, T, ...), base frame.
        training: strength of each augmentation.
        generator: random generator on the tensors' device.
        ordered: whether the network identifies points by index. If True, no point is dropped.
    """
    found = dict(seen)
    cloud = seen[CLOUD]
    batch, frames, count, channels = cloud.shape
    made = {"generator": generator, "device": cloud.device}
    if training.dropout > 0 and not ordered:
        share = training.dropout * torch.rand(batch, frames, 1, **made)
        dropped = torch.rand(batch, frames, count, **made) < share
        order = torch.arange(count, device=cloud.device).expand(batch, frames, count)
        shift = torch.randint(0, count, (batch, frames, count), **made)
        rows = torch.where(dropped, shift, order)
        cloud = torch.gather(cloud, 2, rows[..., None].expand(-1, -1, -1, channels))
    xyz, colours = cloud[..., :3], cloud[..., 3:]
    if training.jitter > 0:
        xyz = xyz + training.jitter * torch.randn(xyz.shape, **made)
    if training.colour_jitter > 0 and channels > 3:
        shift = training.colour_jitter * torch.randn(batch, 1, 1, 3, **made)
        colours = (colours + shift).clamp(0.0, 1.0)
    found[CLOUD] = torch.cat([xyz, colours], -1)
    if training.yaw > 0:
        found = yawed(found, training.yaw * (2 * torch.rand(batch, **made) - 1))
    return found


def holds(width: Any, command: Any) -> Any:
    """Return element by element whether the fingers may hold an object: the command closes them, but they are apart.

    Args:
        width: distance of the finger pads, m.
        command: last gripper command, -1 to 1.
    """
    return (command < HOLDS_COMMAND) & (width > HOLDS_WIDTH)


def off_its_way(
    batch: Mapping[str, torch.Tensor], profile: RobotProfile, training: TrainConfig, generator: torch.Generator
) -> dict[str, torch.Tensor]:
    """Perturb the arm's joints in half of the samples, to teach motions back to the demonstrated path (Ke et al. 2021).

    All frames of a perturbed sample get the same Gaussian noise on the joints, with a standard deviation of at most
    ``arm_noise``, and new tool poses. The noise is subtracted from the relative actions, so that they still lead to the
    demonstrated joints. Samples in which the hand may hold an object are not changed, because the object would have to
    move along.

    Args:
        batch: columns (B, T, ...) in the base frame. Clouds do not contain the robot, and actions are relative to the
            present joints.
        training: ``arm_noise`` is the largest standard deviation, rad.
        generator: random generator on the tensors' device.
    """
    found = dict(batch)
    state, fingers, m = batch[STATE], batch[GRIPPER][:, -1], profile.arm_size
    made = {"generator": generator, "device": state.device}
    off = (torch.rand(len(state), **made) < OFF) & ~holds(fingers[:, 0], fingers[:, 1])
    size = training.arm_noise * torch.rand(len(state), 1, **made) * off[:, None]
    noise = size * torch.randn(len(state), m, **made)
    joints = state.clone()
    joints[..., :m] += noise[:, None]
    found[STATE] = joints
    poses = tool_pose(profile, joints.flatten(0, 1).cpu().numpy())
    pose = torch.from_numpy(poses).to(state.device).reshape(batch[TOOL_POSE].shape)
    found[TOOL_POSE] = torch.where(off[:, None, None], pose, batch[TOOL_POSE])
    found[ACTION] = batch[ACTION].clone()
    found[ACTION][..., :m] -= noise[:, None]
    if KEY_POSITIONS in batch:
        was, now = batch[TOOL_POSE][:, -1], found[TOOL_POSE][:, -1]
        R_was, R_now = matrix_of_quaternion(was[:, 3:]), matrix_of_quaternion(now[:, 3:])
        base = batch[KEY_POSITIONS] @ R_was.transpose(1, 2) + was[:, None, :3]
        found[KEY_POSITIONS] = (base - now[:, None, :3]) @ R_now
        found[KEY_ROTATIONS] = (R_now.transpose(1, 2) @ R_was)[:, None] @ batch[KEY_ROTATIONS]
    return found

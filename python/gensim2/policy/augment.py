"""Augmentation of batches: jitter and dropout of points, colours, yaw."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import torch

from gensim2.observations.columns import CLOUD
from gensim2.policy.frames import yawed

if TYPE_CHECKING:
    from gensim2.policy.config import TrainConfig


def augmented(
    seen: Mapping[str, torch.Tensor], training: TrainConfig, generator: torch.Generator
) -> dict[str, torch.Tensor]:
    """Return a batch as it might have been seen as well.

    Dropped points are replaced by others of the same cloud: the number of points stays. Every sample drops a share of
    its own, up to ``dropout``.

    Args:
        seen: by column, (B, T, ...), base frame.
        generator: on the tensors' device.
    """
    found = dict(seen)
    cloud = seen[CLOUD]
    batch, frames, count, channels = cloud.shape
    made = {"generator": generator, "device": cloud.device}
    if training.dropout > 0:
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

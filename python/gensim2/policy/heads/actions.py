"""Action chunks: their columns, and their normalization.

A chunk is (B, H, m + 2). The first m columns are targets of the arm's joints relative to the present joints, rad or m;
then the gripper from -1 (closed) to 1 (open); then whether the episode is over by that step, -1 or 1. Relative targets
do not change when scene and robot are turned about the base.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import nn

ACTION = "action"
"""Name of the target: (B, H, m + 2) chunks."""

EXTRA = 2
"""Columns behind the arm's."""

SMALLEST = 1e-3
"""Smallest scale, rad or m: joints that hardly move are not blown up."""


class ActionScale(nn.Module):  # type: ignore[misc]
    """Mean and standard deviation of each number of a chunk but for the gripper and the end, which stay as they are.

    A chunk's late steps move farther than its early ones: each has a scale of its own.

    Args:
        horizon, arm: H and m.
    """

    mean: torch.Tensor
    scale: torch.Tensor

    def __init__(self, horizon: int, arm: int) -> None:
        super().__init__()
        self.arm = arm
        self.register_buffer("mean", torch.zeros(horizon, arm + EXTRA))
        self.register_buffer("scale", torch.ones(horizon, arm + EXTRA))

    def fit(self, batch: Mapping[str, torch.Tensor]) -> None:
        """Set them from many chunks."""
        chunks = batch[ACTION][..., : self.arm].double()
        self.mean[:, : self.arm] = chunks.mean(0).float()
        self.scale[:, : self.arm] = chunks.std(0, correction=0).clamp(min=SMALLEST).float()

    def normalized(self, chunk: torch.Tensor) -> torch.Tensor:
        """Return chunks of mean 0 and deviation 1."""
        return (chunk - self.mean) / self.scale

    def restored(self, normal: torch.Tensor) -> torch.Tensor:
        """Return chunks in rad and m."""
        return normal * self.scale + self.mean

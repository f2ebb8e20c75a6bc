"""Define the columns of action chunks, and normalize chunks.

A chunk of H control steps is (B, H, m + 2). A row has the arm targets minus the present joints, rad or m. These
differences stay the same if scene and robot are rotated about the base's z axis. The gripper command from -1 (closed)
to 1 (open) follows. The last value is the end mark: 1 if the episode has ended by this step, else -1.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import nn

ACTION = "action"
"""Name of the batch column with the target chunks (B, H, m + 2)."""

EXTRA = 2
"""Number of action columns after the columns of the arm's joints: gripper command and end mark."""

SMALLEST = 1e-3
"""Smallest scale, rad or m, so that the noise of nearly constant joints is not amplified."""


class ActionScale(nn.Module):  # type: ignore[misc]
    """Mean and standard deviation of each joint target of a chunk; gripper and end mark are not scaled.

    Each step of a chunk has its own scale, because late steps are farther from the present joints than early steps.

    Args:
        horizon: H, number of actions in a chunk.
        arm: m, number of the arm's joints.
    """

    mean: torch.Tensor
    scale: torch.Tensor

    def __init__(self, horizon: int, arm: int) -> None:
        super().__init__()
        self.arm = arm
        self.register_buffer("mean", torch.zeros(horizon, arm + EXTRA))
        self.register_buffer("scale", torch.ones(horizon, arm + EXTRA))

    def fit(self, batch: Mapping[str, torch.Tensor]) -> None:
        """Compute the mean and the standard deviation of each joint target from a large batch of chunks."""
        chunks = batch[ACTION][..., : self.arm].double()
        self.mean[:, : self.arm] = chunks.mean(0).float()
        self.scale[:, : self.arm] = chunks.std(0, correction=0).clamp(min=SMALLEST).float()

    def normalized(self, chunk: torch.Tensor) -> torch.Tensor:
        """Return chunks with mean 0 and standard deviation 1."""
        return (chunk - self.mean) / self.scale

    def restored(self, normal: torch.Tensor) -> torch.Tensor:
        """Undo the normalization: return chunks in rad and m."""
        return normal * self.scale + self.mean

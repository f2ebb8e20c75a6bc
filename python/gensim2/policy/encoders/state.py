"""MLP on points that are known by their place in the list, the scene's state: a privileged baseline."""

from __future__ import annotations

import torch
from torch import nn


class StateEncoder(nn.Module):  # type: ignore[misc]
    """MLP 256-256 on all numbers of all points at once; a point's feature is its own beside that of all.

    Args:
        channels: C, numbers a point.
        points: N.
    """

    tokens, width, feature_width = 1, 256, 64 + 256

    def __init__(self, channels: int, points: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(channels * points, self.width),
            nn.LayerNorm(self.width),
            nn.GELU(),
            nn.Linear(self.width, self.width),
            nn.LayerNorm(self.width),
            nn.GELU(),
            nn.Linear(self.width, self.width),
        )
        self.of_point = nn.Linear(channels, 64)

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """Return the pooled token (B, 1, 256)."""
        return self.layers(points.flatten(1))[:, None]

    def with_features(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the pooled token (B, 1, 256) and the features (B, N, 320)."""
        pooled = self(points)
        return pooled, torch.cat([self.of_point(points), pooled.expand(-1, points.shape[1], -1)], -1)

"""MLP encoders: a PointNet without transforms, and an MLP on the concatenated points."""

from __future__ import annotations

import torch
from torch import nn

ROWS = 1024
"""Number of points that the CPU processes at once, chosen so that intermediate results fit into its cache."""


class StateEncoder(nn.Module):  # type: ignore[misc]
    """MLP that encodes a cloud with a fixed order of points, such as keypoints.

    The encoder computes one token from all points. Some heads need a feature of each point, which is the point's linear
    embedding joined with the token.

    Args:
        channels: C, number of channels of a point.
        points: N, number of points in a cloud.
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


class MlpEncoder(nn.Module):  # type: ignore[misc]
    """MLP 64-128-192 with LayerNorm on each point, followed by a maximum over the points.

    The maximum passes gradients only to the largest point of each channel, about 90 of 512 points. So these points are
    found without gradients first, and only they are evaluated with gradients, in half of the time.

    Args:
        channels: C, number of channels of a point.
    """

    tokens, width, feature_width = 1, 192, 192

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(channels, 64),
            nn.LayerNorm(64),
            nn.GELU(),
            nn.Linear(64, 128),
            nn.LayerNorm(128),
            nn.GELU(),
            nn.Linear(128, self.width),
        )

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """Return the pooled token (B, 1, 192)."""
        if not (self.training and torch.is_grad_enabled()):
            return self.layers(points).amax(1, keepdim=True)
        batch, count, _ = points.shape
        with torch.no_grad():
            winners = self._winners(points)
            flat = winners + count * torch.arange(batch, device=points.device)[:, None]
            rows, of_row = torch.unique(flat, return_inverse=True)
        # shape (U, F): features of the U points that attain a maximum
        values = self.layers(points.reshape(batch * count, -1)[rows])
        column = torch.arange(self.width, device=points.device).expand_as(of_row)
        return values[of_row, column][:, None]

    def _winners(self, points: torch.Tensor) -> torch.Tensor:
        """Return the index (B, F) of the point at which each of F features is largest."""
        batch, count, _ = points.shape
        clouds = max(ROWS // count, 1) if points.device.type == "cpu" else batch
        # ``max(1).indices`` gives the same result as ``argmax(1)``, but takes only a third of the time.
        parts = [self.layers(part).max(1).indices for part in points.split(clouds)]
        return torch.cat(parts)

    def with_features(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the pooled token (B, 1, 192) and the features (B, N, 192)."""
        features = self.layers(points)
        # ``max`` passes the gradient to one point. ``amax`` would divide it among equal points.
        return features.max(1, keepdim=True).values, features
